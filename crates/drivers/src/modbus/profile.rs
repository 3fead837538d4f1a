//! Register map: the meaning of the registers of a Modbus device.

use super::keys::{self, decimals, force, outputs, probe, register, root, sign, status};
use super::number::{Encoding, RegisterNumber, WordOrder};
use super::request::{Function, Transport};
use palpate_document::{self as document, Problem, Problems, Table};

/// Register maps included with the program: name and text.
pub const SHIPPED: [(&str, &str); 6] = [
    ("generic-rs485", include_str!("../../../../profiles/generic-rs485.toml")),
    ("labjack-t7", include_str!("../../../../profiles/labjack-t7.toml")),
    ("laumas-tlb", include_str!("../../../../profiles/laumas-tlb.toml")),
    ("robotiq-ft300", include_str!("../../../../profiles/robotiq-ft300.toml")),
    ("seneca-zsg", include_str!("../../../../profiles/seneca-zsg.toml")),
    ("seneca-zsg2", include_str!("../../../../profiles/seneca-zsg2.toml")),
];

/// Meaning of the registers of a Modbus device.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// The device's name in messages.
    pub name: String,
    /// The protocol of the device, on any link.
    pub transport: Transport,
    /// Modbus unit (slave) id of the device.
    pub unit_id: u8,
    /// Longest wait for an answer, ms.
    pub deadline_ms: u64,
    /// Least time between an answer and the next request, ms.
    pub rest_ms: u64,
    /// Largest number of registers in one answer.
    pub registers_max: u16,
    /// Position of a load cell's force.
    pub force: Option<Force>,
    /// Status that the load cell reports.
    pub status: Option<StatusWord>,
    /// Position of an array's outputs.
    pub outputs: Option<OutputRegisters>,
    /// Registers with known values. They show at connection that addresses and word order are right.
    pub probe: Vec<Probe>,
}

/// Position of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Function that reads the number.
    pub function: Function,
    /// Address of its first register on the wire.
    pub address: u16,
    /// Encoding of the content.
    pub encoding: Encoding,
}

/// The force registers of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// Position of the force, or of the first of three.
    pub register: Register,
    /// Whether there are three: forces along x, y and z of the cell, one after another.
    pub axes: bool,
    /// Newtons per unit of the device, before its decimals.
    pub newton_per_unit: f64,
    /// Device reading at zero force, in the device's units.
    pub offset: f64,
    /// Largest force that the device can measure, N. A larger reading is damaged, or decoded wrongly.
    pub range_n: Option<f64>,
    /// Register with the number of decimals of the device's integer; `None` if there are no decimals.
    pub decimals: Option<Register>,
    /// Bit that marks a magnitude as negative. It is read together with the force.
    pub sign: Option<Bit>,
}

/// One bit of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bit {
    /// Address on the wire.
    pub address: u16,
    /// 0 (least significant) to 15.
    pub bit: u8,
}

/// The status word of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct StatusWord {
    /// Address on the wire.
    pub address: u16,
    /// Bits for a reading beyond the range.
    pub saturated_bits: Vec<u8>,
    /// Bits for a broken cell or converter.
    pub fault_bits: Vec<u8>,
}

/// Output registers of an array, one number for each unit, without gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputRegisters {
    /// Position of the first unit's number.
    pub register: Register,
    /// Largest number of units that can be read.
    pub count_max: usize,
}

/// A register with a known value.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Name of the register in the device's manual.
    pub what: String,
    /// Position of the register.
    pub register: Register,
    /// Value of the register.
    pub value: f64,
}

impl Profile {
    /// Reads a register map; `file` is its name in messages.
    ///
    /// # Errors
    /// All problems of the text, each with its line.
    pub fn parse(file: &str, text: &str) -> Result<Profile, Problems> {
        document::read(file, text, &root::KEYS, |table| {
            let name = table.text(&root::name);
            let transport = table.word(&root::transport, &keys::TRANSPORTS);
            let unit_id = table.whole(&root::unit_id);
            let deadline_ms = table.whole(&root::deadline_ms);
            let rest_ms = table.whole(&root::rest_ms);
            let registers_max = table.whole(&root::registers_max).unwrap_or(keys::REGISTERS_MAX) as u16;
            let base = table.whole(&root::address_base).unwrap_or(0);
            let force = document::optional(table.table(&root::force), |table| read_force(table, base, registers_max));
            let status = document::optional(table.table(&root::status), |table| read_status(table, base));
            let outputs =
                document::optional(table.table(&root::outputs), |table| read_outputs(table, base, registers_max));
            let probe = document::all(table.tables(&root::probe).iter().map(|table| read_probe(table, base)));
            Some(Profile {
                name: name?.to_owned(),
                transport: transport?,
                unit_id: unit_id? as u8,
                deadline_ms: deadline_ms?,
                rest_ms: rest_ms?,
                registers_max,
                force: force?,
                status: status?,
                outputs: outputs?,
                probe: probe?,
            })
        })
    }

    /// Returns a register map included with the program; `None` if there is no map of that name.
    pub fn shipped(name: &str) -> Option<Profile> {
        let (_, text) = SHIPPED.iter().find(|(shipped, _)| *shipped == name)?;
        Profile::parse(name, text).ok() // a test reads every one of them
    }
}

impl Force {
    /// Number of forces.
    pub fn count(&self) -> u16 {
        if self.axes { 3 } else { 1 }
    }

    /// Returns the first address and the number of registers of one read that includes the forces and their sign.
    pub fn block(&self) -> (u16, u16) {
        let own = self.count() * self.register.encoding.registers();
        let (first, last) = (self.register.address, self.register.address.saturating_add(own - 1));
        let (first, last) = self.sign.map_or((first, last), |sign| (first.min(sign.address), last.max(sign.address)));
        (first, last - first + 1)
    }
}

fn read_force(table: &Table, base: u64, registers_max: u16) -> Option<Force> {
    let register = read_register(table, base);
    let newton_per_unit = table.number(&force::newton_per_unit);
    let offset = table.number(&force::offset);
    let range_n = table.number(&force::range_n);
    let axes = table.flag(&force::axes);
    let decimals = document::optional(table.table(&force::decimals), |table| {
        let address = read_address(table, base);
        let (mask, shift) = (table.whole(&decimals::mask), table.whole(&decimals::shift));
        let (mask, shift) = (Some(mask? as u32), shift? as u8);
        let encoding = Encoding { mask, shift, ..Encoding::plain(RegisterNumber::U16, WordOrder::Big) };
        Some(Register { function: Function::Holding, address: address?, encoding })
    });
    let sign = document::optional(table.table(&force::sign), |table| {
        let (address, bit) = (read_address(table, base), table.whole(&sign::bit));
        Some(Bit { address: address?, bit: bit? as u8 })
    });
    let (decimals, sign) = (decimals?, sign?);
    let (register, newton_per_unit, offset, axes) = (register?, newton_per_unit?, offset?, axes?);
    let force = Force { register, axes, newton_per_unit, offset, range_n, decimals, sign };
    if axes && sign.is_some() {
        table.complain(Problem::new(table.span_of(&force::sign), "`sign` is for a cell with one axis"));
    } else if axes && force.block().1 > registers_max {
        let text = format!("the forces are {} registers, more than `registers_max`", force.block().1);
        table.complain(Problem::new(table.span_of(&force::axes), text));
    } else if force.block().1 > registers_max {
        let text = format!("the sign is {} registers from the force, too far to read both together", force.block().1);
        let problem = Problem::new(table.span_of(&force::sign), text);
        table.complain(problem.help("they must be at most `registers_max` apart, to be read at the same moment"));
    }
    Some(force)
}

fn read_status(table: &Table, base: u64) -> Option<StatusWord> {
    let address = read_address(table, base);
    let bits = |key| table.wholes(key).unwrap_or_default().into_iter().map(|bit| bit as u8).collect();
    let (saturated_bits, fault_bits) = (bits(&status::saturated_bits), bits(&status::fault_bits));
    Some(StatusWord { address: address?, saturated_bits, fault_bits })
}

fn read_outputs(table: &Table, base: u64, registers_max: u16) -> Option<OutputRegisters> {
    let register = read_register(table, base);
    let each = register.as_ref().map_or(1, |register| register.encoding.registers());
    let count_max = table.whole_within(&outputs::count_max, 1, u64::from(registers_max / each));
    Some(OutputRegisters { register: register?, count_max: count_max? as usize })
}

fn read_probe(table: &Table, base: u64) -> Option<Probe> {
    let what = table.text(&probe::what);
    let register = read_register(table, base);
    let value = table.number(&probe::value);
    Some(Probe { what: what?.to_owned(), register: register?, value: value? })
}

/// Converts an address in the manual to the address on the wire. `base` is the manual's number of the first register.
fn read_address(table: &Table, base: u64) -> Option<u16> {
    let address = table.whole_within(&register::address, base, base + u64::from(u16::MAX));
    address.map(|address| (address - base) as u16)
}

fn read_register(table: &Table, base: u64) -> Option<Register> {
    let function = table.word(&register::function, &keys::FUNCTIONS);
    let address = read_address(table, base);
    let number = table.word(&register::number_type, &keys::NUMBER_TYPES);
    let word_order = match number.is_some_and(|number| number.registers() == 1) && !table.has(&register::word_order) {
        true => Some(WordOrder::Big),
        false => {
            table.require(&register::word_order);
            table.word(&register::word_order, &keys::WORD_ORDERS)
        }
    };
    let swap_bytes = table.flag(&register::swap_bytes);
    let mask = table.whole(&register::mask).map(|mask| mask as u32);
    let shift = table.whole(&register::shift).map(|shift| shift as u8);
    if mask.is_some() && number.is_some_and(|number| !number.is_whole()) {
        let text = "`mask` requires a whole number, but this is a float";
        table.complain(Problem::new(table.span_of(&register::mask), text));
    }
    let encoding = Encoding { number: number?, word_order: word_order?, swap_bytes: swap_bytes?, mask, shift: shift? };
    Some(Register { function: function?, address: address?, encoding })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_map_can_be_read() {
        for (name, text) in SHIPPED {
            Profile::parse(name, text).unwrap();
        }
    }

    #[test]
    fn three_forces_have_no_sign_bit_and_one_read() {
        let map = |more: &str| {
            let (_, text) = SHIPPED.iter().find(|(name, _)| *name == "robotiq-ft300").unwrap();
            Profile::parse("mine.toml", &text.replace("axes = true", more)).map_err(|problems| problems.lines())
        };
        assert_eq!(map("axes = true").unwrap().force.unwrap().block(), (180, 3));
        assert_eq!(map("axes = false").unwrap().force.unwrap().block(), (180, 1));
        let sign = "axes = true\nsign = { address = 190, bit = 0 }\n#";
        assert_eq!(map(sign).unwrap_err(), ["mine.toml:16:8: `sign` is for a cell with one axis"]);
        let (_, text) = SHIPPED[0];
        let few = text.replace("[force]", "registers_max = 4\n[force]\naxes = true");
        let expected = ["mine.toml:10:8: the forces are 6 registers, more than `registers_max`"];
        assert_eq!(Profile::parse("mine.toml", &few).unwrap_err().lines(), expected);
        // beyond the last register, which a read finds out
        let end = text.replace("address = 80", "address = 65535\naxes = true");
        assert_eq!(Profile::parse("mine.toml", &end).unwrap().force.unwrap().block(), (65_535, 1));
    }

    #[test]
    fn all_mistakes_of_a_map_are_reported_at_their_lines() {
        let (_, text) = SHIPPED[0];
        let text = text.replace("unit_id", "unit").replace("\"i32\"", "\"i23\"").replace("[6, 9]", "[6, 19]");
        assert_eq!(
            Profile::parse("mine.toml", &text).unwrap_err().lines(),
            [
                "mine.toml:5:1: unknown key `unit`",
                "mine.toml:10:8: `type` is \"i23\", expected one of u16, i16, u32, i32, f32, f64",
                "mine.toml:17:22: `saturated_bits` is 19, must be 0 to 15",
            ]
        );
    }
}
