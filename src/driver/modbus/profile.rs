use super::number::{Encoding, NumberType, WordOrder};
use crate::document::{self, Bounds, Problem, Problems, Table};

/// The register maps that come with the program: name and text.
pub const SHIPPED: [(&str, &str); 4] = [
    ("generic-rs485", include_str!("../../../profiles/generic-rs485.toml")),
    ("labjack-t7", include_str!("../../../profiles/labjack-t7.toml")),
    ("laumas-tlb", include_str!("../../../profiles/laumas-tlb.toml")),
    ("seneca-zsg", include_str!("../../../profiles/seneca-zsg.toml")),
];

/// Which registers of a Modbus device mean what.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// The device's name in messages.
    pub name: String,
    /// What the device itself speaks, whatever link a rig puts it on.
    pub transport: Transport,
    /// Its Modbus unit (slave) id.
    pub unit_id: u8,
    /// Longest wait for an answer, ms.
    pub deadline_ms: u64,
    /// Least rest between an answer and the next request, ms.
    pub rest_ms: u64,
    /// Most registers it gives at once.
    pub registers_max: u16,
    /// Where a load cell's force is.
    pub force: Option<Force>,
    /// What it says of itself.
    pub status: Option<Status>,
    /// Where an array's outputs are.
    pub outputs: Option<Outputs>,
    /// Registers whose value is known: they show at connect that addresses and word order are right.
    pub probe: Vec<Probe>,
}

/// How Modbus is framed on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Serial line, CRC and silence.
    Rtu,
    /// TCP, with a header that numbers the transactions.
    Tcp,
}

/// With which function registers are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Function code 3.
    Holding,
    /// Function code 4.
    Input,
}

impl Function {
    /// The function that this one's answer can't be taken for.
    pub fn other(self) -> Function {
        match self {
            Function::Holding => Function::Input,
            Function::Input => Function::Holding,
        }
    }
}

/// Where a number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// With which function it is read.
    pub function: Function,
    /// Address on the wire of its first register.
    pub address: u16,
    /// What it holds.
    pub encoding: Encoding,
}

/// The force register of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// Where it is.
    pub register: Register,
    /// N per unit of the device, before its decimals.
    pub newton_per_unit: f64,
    /// What the device reads at no force, in its units.
    pub offset: f64,
    /// Most that the device can measure, N: a reading beyond is damaged, or decoded wrongly.
    pub range_n: Option<f64>,
    /// Where the device says how many decimals its integer has; none: it has none.
    pub decimals: Option<Register>,
    /// The bit that says a magnitude is negative. It is read together with the force.
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
pub struct Status {
    /// Address on the wire.
    pub address: u16,
    /// Bits that say the reading is beyond its range.
    pub saturated_bits: Vec<u8>,
    /// Bits that say the cell or its converter is broken.
    pub fault_bits: Vec<u8>,
}

/// The output registers of an array, one number a unit, without gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct Outputs {
    /// Where the first unit's is.
    pub register: Register,
    /// Most units that can be read.
    pub count_max: usize,
}

/// A register whose value is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Its name in the device's manual.
    pub what: String,
    /// Where it is.
    pub register: Register,
    /// Its value.
    pub value: f64,
}

const TRANSPORTS: [(&str, Transport); 2] = [("rtu", Transport::Rtu), ("tcp", Transport::Tcp)];
const WORD_ORDERS: [(&str, WordOrder); 2] = [("big", WordOrder::Big), ("little", WordOrder::Little)];
const FUNCTIONS: [(&str, Function); 2] = [("holding", Function::Holding), ("input", Function::Input)];
const NUMBER_TYPES: [(&str, NumberType); 6] = [
    ("u16", NumberType::U16),
    ("i16", NumberType::I16),
    ("u32", NumberType::U32),
    ("i32", NumberType::I32),
    ("f32", NumberType::F32),
    ("f64", NumberType::F64),
];
const FORCE_PER_UNIT: Bounds = Bounds::within(-1e6, 1e6, "N");
const OFFSET: Bounds = Bounds::within(-1e12, 1e12, "units of the device");
const RANGE: Bounds = Bounds::above(0.0, 1e6, "N");
const VALUE: Bounds = Bounds::within(-1e12, 1e12, "");
const REST_MS_MAX: u64 = 1000;
/// A manual that counts from 40001 for the first holding register, and one that counts from 30001 for the first input one.
const BASE_MAX: u64 = 40_001;
/// One Modbus read carries at most 125 registers (Modbus specification).
const REGISTERS_MAX: u64 = 125;

impl Profile {
    /// Reads a register map; `file` is its name in messages.
    ///
    /// # Errors
    /// Every problem of the text, each at its line.
    pub fn parse(file: &str, text: &str) -> Result<Profile, Problems> {
        document::read(file, text, |root| {
            let name = root.require_text("name", "the device's name in messages");
            let transport = root.require_choice("transport", &TRANSPORTS);
            let unit_id = root.require_integer("unit_id", 0, 255);
            let deadline_ms = root.require_integer("deadline_ms", 1, 60_000);
            let rest_ms = root.integer("rest_ms", 0, REST_MS_MAX).unwrap_or(0);
            let registers_max = root.integer("registers_max", 1, REGISTERS_MAX).unwrap_or(REGISTERS_MAX) as u16;
            let base = root.integer("address_base", 0, BASE_MAX).unwrap_or(0);
            let force = optional(root.table("force"), |table| read_force(table, base, registers_max));
            let status = optional(root.table("status"), |table| read_status(table, base));
            let outputs = optional(root.table("outputs"), |table| read_outputs(table, base, registers_max));
            let probe = document::all(root.tables("probe").into_iter().map(|table| read_probe(table, base)));
            Some(Profile {
                name: name?.to_owned(),
                transport: transport?,
                unit_id: unit_id? as u8,
                deadline_ms: deadline_ms?,
                rest_ms,
                registers_max,
                force: force?,
                status: status?,
                outputs: outputs?,
                probe: probe?,
            })
        })
    }

    /// A register map that came with the program, or none of that name.
    pub fn shipped(name: &str) -> Option<Profile> {
        let (_, text) = SHIPPED.iter().find(|(shipped, _)| *shipped == name)?;
        Profile::parse(name, text).ok() // a test reads every one of them
    }
}

impl Force {
    /// Where one read begins that has the force and its sign, and how many registers it has.
    pub fn block(&self) -> (u16, u16) {
        let (first, last) = (self.register.address, self.register.address + (self.register.encoding.registers() - 1));
        let (first, last) = self.sign.map_or((first, last), |sign| (first.min(sign.address), last.max(sign.address)));
        (first, last - first + 1)
    }
}

/// A table that may be missing, but must be right where it is there.
fn optional<T>(table: Option<Table>, read: impl FnOnce(Table) -> Option<T>) -> Option<Option<T>> {
    match table {
        Some(table) => read(table).map(Some),
        None => Some(None),
    }
}

fn read_force(mut table: Table, base: u64, registers_max: u16) -> Option<Force> {
    let register = read_register(&mut table, base);
    let newton_per_unit = table.require_number("newton_per_unit", FORCE_PER_UNIT);
    let offset = table.number("offset", OFFSET).unwrap_or(0.0);
    let range_n = table.number("range_n", RANGE);
    let decimals = optional(table.table("decimals"), |mut decimals| {
        let address = read_address(&mut decimals, base);
        let mask = decimals.require_integer("mask", 1, u64::from(u16::MAX));
        let shift = decimals.integer("shift", 0, 15).unwrap_or(0) as u8;
        decimals.finish();
        let encoding = Encoding { mask: Some(mask? as u32), shift, ..Encoding::plain(NumberType::U16, WordOrder::Big) };
        Some(Register { function: Function::Holding, address: address?, encoding })
    });
    let sign_span = table.span_of("sign");
    let sign = optional(table.table("sign"), |mut sign| {
        let (address, bit) = (read_address(&mut sign, base), sign.require_integer("bit", 0, 15));
        sign.finish();
        Some(Bit { address: address?, bit: bit? as u8 })
    });
    let force = (|| {
        let (decimals, sign) = (decimals?, sign?);
        Some(Force { register: register?, newton_per_unit: newton_per_unit?, offset, range_n, decimals, sign })
    })();
    if let Some(force) = &force
        && force.block().1 > registers_max
    {
        let told = format!("the sign is {} registers from the force: they can't be read together", force.block().1);
        table.complain(Problem::new(sign_span, told).help("at most `registers_max` apart: both are of one moment"));
    }
    table.finish();
    force
}

fn read_status(mut table: Table, base: u64) -> Option<Status> {
    let address = read_address(&mut table, base);
    let mut bits = |key| table.integers(key, 0, 15).unwrap_or_default().into_iter().map(|bit| bit as u8).collect();
    let (saturated_bits, fault_bits) = (bits("saturated_bits"), bits("fault_bits"));
    table.finish();
    Some(Status { address: address?, saturated_bits, fault_bits })
}

fn read_outputs(mut table: Table, base: u64, registers_max: u16) -> Option<Outputs> {
    let register = read_register(&mut table, base);
    let each = register.as_ref().map_or(1, |register| register.encoding.registers());
    let count_max = table.require_integer("count_max", 1, u64::from(registers_max / each));
    table.finish();
    Some(Outputs { register: register?, count_max: count_max? as usize })
}

fn read_probe(mut table: Table, base: u64) -> Option<Probe> {
    let what = table.require_text("what", "its name in the device's manual");
    let register = read_register(&mut table, base);
    let value = table.require_number("value", VALUE);
    table.finish();
    Some(Probe { what: what?.to_owned(), register: register?, value: value? })
}

/// The address on the wire of one in the manual, whose first register has the number `base`.
fn read_address(table: &mut Table, base: u64) -> Option<u16> {
    table.require_integer("address", base, base + u64::from(u16::MAX)).map(|address| (address - base) as u16)
}

fn read_register(table: &mut Table, base: u64) -> Option<Register> {
    let function = table.choice("function", &FUNCTIONS).unwrap_or(Function::Holding);
    let address = read_address(table, base);
    let number = table.require_choice("type", &NUMBER_TYPES);
    // of one register there is only one order
    let is_one = number.is_some_and(|number| number.registers() == 1);
    let word_order = match is_one && !table.has("word_order") {
        true => Some(WordOrder::Big),
        false => table.require_choice("word_order", &WORD_ORDERS),
    };
    let swap_bytes = table.flag("swap_bytes").unwrap_or(false);
    let mask = table.integer("mask", 1, u64::from(u32::MAX)).map(|mask| mask as u32);
    let shift = table.integer("shift", 0, 31).unwrap_or(0) as u8;
    if mask.is_some() && number.is_some_and(|number| !number.is_whole()) {
        table.complain(Problem::new(table.span_of("mask"), "`mask` picks bits of a whole number, this is a float"));
    }
    let encoding = Encoding { number: number?, word_order: word_order?, swap_bytes, mask, shift };
    Some(Register { function, address: address?, encoding })
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
    fn all_mistakes_of_a_map_are_told_at_their_lines() {
        let (_, text) = SHIPPED[0];
        let text = text.replace("unit_id", "unit").replace("\"i32\"", "\"i23\"").replace("[6, 9]", "[6, 19]");
        assert_eq!(
            Profile::parse("mine.toml", &text).unwrap_err().lines(),
            [
                "mine.toml:1:1: `unit_id` is missing: a whole number, 0 to 255",
                "mine.toml:5:1: unknown key `unit`",
                "mine.toml:10:8: `type` is \"i23\", expected one of u16, i16, u32, i32, f32, f64",
                "mine.toml:17:22: `saturated_bits` must be 0 to 15",
            ]
        );
    }
}
