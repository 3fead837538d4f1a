use crate::document::{self, Bounds, Problems, Table};

/// The register maps that come with the program: name and text.
pub const SHIPPED: [(&str, &str); 2] = [
    ("generic-rs485", include_str!("../../../profiles/generic-rs485.toml")),
    ("labjack-t7", include_str!("../../../profiles/labjack-t7.toml")),
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

/// The force register of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// Address on the wire of its first register.
    pub address: u16,
    /// What it holds.
    pub number: NumberType,
    /// Which word comes first.
    pub word_order: WordOrder,
    /// N per unit of the device, before its decimals.
    pub newton_per_unit: f64,
    /// Where the device says how many decimals its integer has; none: it has none.
    pub decimals: Option<Decimals>,
}

/// Where a device keeps its number of decimals.
#[derive(Clone, Debug, PartialEq)]
pub struct Decimals {
    /// Address on the wire.
    pub address: u16,
    /// The bits that hold the number.
    pub mask: u16,
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
    /// Address on the wire of the first unit's first register.
    pub address: u16,
    /// What each holds.
    pub number: NumberType,
    /// Which word comes first.
    pub word_order: WordOrder,
    /// Most units that can be read.
    pub count_max: usize,
}

/// A register whose value is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Its name in the device's manual.
    pub what: String,
    /// Address on the wire.
    pub address: u16,
    /// What it holds.
    pub number: NumberType,
    /// Its value.
    pub value: f64,
}

/// What registers hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberType {
    /// One register, unsigned.
    U16,
    /// One register, two's complement.
    I16,
    /// Two registers, unsigned.
    U32,
    /// Two registers, two's complement.
    I32,
    /// Two registers, IEEE 754 single.
    F32,
}

/// Which of two registers is the more significant; bytes within a register are always high first (Modbus specification).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordOrder {
    /// The one at the lower address.
    Big,
    /// The one at the higher address.
    Little,
}

const TRANSPORTS: [(&str, Transport); 2] = [("rtu", Transport::Rtu), ("tcp", Transport::Tcp)];
const WORD_ORDERS: [(&str, WordOrder); 2] = [("big", WordOrder::Big), ("little", WordOrder::Little)];
const NUMBER_TYPES: [(&str, NumberType); 5] = [
    ("u16", NumberType::U16),
    ("i16", NumberType::I16),
    ("u32", NumberType::U32),
    ("i32", NumberType::I32),
    ("f32", NumberType::F32),
];
const ADDRESS_MAX: u64 = 65_535;
const FORCE_PER_UNIT: Bounds = Bounds::within(-1e6, 1e6, "N");
const VALUE: Bounds = Bounds::within(-1e12, 1e12, "");
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
            let force = optional(root.table("force"), read_force);
            let status = optional(root.table("status"), read_status);
            let outputs = optional(root.table("outputs"), read_outputs);
            let probe = document::all(root.tables("probe").into_iter().map(read_probe));
            Some(Profile {
                name: name?.to_owned(),
                transport: transport?,
                unit_id: unit_id? as u8,
                deadline_ms: deadline_ms?,
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

/// A table that may be missing, but must be right where it is there.
fn optional<T>(table: Option<Table>, read: fn(Table) -> Option<T>) -> Option<Option<T>> {
    match table {
        Some(table) => read(table).map(Some),
        None => Some(None),
    }
}

fn read_force(mut table: Table) -> Option<Force> {
    let address = read_address(&mut table);
    let (number, word_order) = read_number(&mut table);
    let newton_per_unit = table.require_number("newton_per_unit", FORCE_PER_UNIT);
    let decimals = optional(table.table("decimals"), |mut decimals| {
        let (address, mask) = (read_address(&mut decimals), decimals.require_integer("mask", 1, ADDRESS_MAX));
        decimals.finish();
        Some(Decimals { address: address?, mask: mask? as u16 })
    });
    table.finish();
    Some(Force {
        address: address?,
        number: number?,
        word_order: word_order?,
        newton_per_unit: newton_per_unit?,
        decimals: decimals?,
    })
}

fn read_status(mut table: Table) -> Option<Status> {
    let address = read_address(&mut table);
    let mut bits = |key| table.integers(key, 0, 15).unwrap_or_default().into_iter().map(|bit| bit as u8).collect();
    let (saturated_bits, fault_bits) = (bits("saturated_bits"), bits("fault_bits"));
    table.finish();
    Some(Status { address: address?, saturated_bits, fault_bits })
}

fn read_outputs(mut table: Table) -> Option<Outputs> {
    let address = read_address(&mut table);
    let (number, word_order) = read_number(&mut table);
    let most = REGISTERS_MAX / number.map_or(1, |number| u64::from(number.registers()));
    let count_max = table.require_integer("count_max", 1, most);
    table.finish();
    Some(Outputs { address: address?, number: number?, word_order: word_order?, count_max: count_max? as usize })
}

fn read_probe(mut table: Table) -> Option<Probe> {
    let what = table.require_text("what", "its name in the device's manual");
    let (address, number) = (read_address(&mut table), table.require_choice("type", &NUMBER_TYPES));
    let value = table.require_number("value", VALUE);
    table.finish();
    Some(Probe { what: what?.to_owned(), address: address?, number: number?, value: value? })
}

fn read_address(table: &mut Table) -> Option<u16> {
    table.require_integer("address", 0, ADDRESS_MAX).map(|address| address as u16)
}

fn read_number(table: &mut Table) -> (Option<NumberType>, Option<WordOrder>) {
    (table.require_choice("type", &NUMBER_TYPES), table.require_choice("word_order", &WORD_ORDERS))
}

impl NumberType {
    /// How many registers one number takes.
    pub fn registers(self) -> u16 {
        match self {
            NumberType::U16 | NumberType::I16 => 1,
            NumberType::U32 | NumberType::I32 | NumberType::F32 => 2,
        }
    }

    /// The number in some registers, or none if there are too few.
    pub fn decode(self, words: &[u16], order: WordOrder) -> Option<f64> {
        if self.registers() == 1 {
            let word = *words.first()?;
            return Some(if self == NumberType::I16 { f64::from(word as i16) } else { f64::from(word) });
        }
        let (high, low) = match order {
            WordOrder::Big => (*words.first()?, *words.get(1)?),
            WordOrder::Little => (*words.get(1)?, *words.first()?),
        };
        let bits = u32::from(high) << 16 | u32::from(low);
        Some(match self {
            NumberType::I32 => f64::from(bits as i32),
            NumberType::F32 => f64::from(f32::from_bits(bits)),
            _ => f64::from(bits),
        })
    }
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
    fn numbers_are_decoded_in_either_word_order() {
        assert_eq!(NumberType::I32.decode(&[0, 132], WordOrder::Big), Some(132.0));
        assert_eq!(NumberType::I32.decode(&[0xFFFF, 0xFFFE], WordOrder::Big), Some(-2.0));
        assert_eq!(NumberType::I32.decode(&[500, 0], WordOrder::Little), Some(500.0));
        assert_eq!(NumberType::F32.decode(&[0x40E0, 0], WordOrder::Big), Some(7.0));
        assert_eq!(NumberType::I16.decode(&[0xFFFF], WordOrder::Big), Some(-1.0));
        assert_eq!(NumberType::U32.decode(&[1], WordOrder::Big), None);
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
                "mine.toml:10:8: `type` is \"i23\", expected one of u16, i16, u32, i32, f32",
                "mine.toml:17:22: `saturated_bits` must be 0 to 15",
            ]
        );
    }
}
