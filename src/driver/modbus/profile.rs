use serde::Deserialize;
use thiserror::Error;

/// The register maps that come with the program: name and text.
pub const SHIPPED: [(&str, &str); 2] = [
    ("generic-rs485", include_str!("../../../profiles/generic-rs485.toml")),
    ("labjack-t7", include_str!("../../../profiles/labjack-t7.toml")),
];

/// Which registers of a Modbus device mean what.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
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
    #[serde(default)]
    pub probe: Vec<Probe>,
}

/// How Modbus is framed on a link.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Transport {
    /// Serial line, CRC and silence.
    Rtu,
    /// TCP, with a header that numbers the transactions.
    Tcp,
}

/// The force register of a load cell.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Force {
    /// Address on the wire of its first register.
    pub address: u16,
    /// What it holds.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which word comes first.
    pub word_order: WordOrder,
    /// N per unit of the device, before its decimals.
    pub newton_per_unit: f64,
    /// Where the device says how many decimals its integer has; none: it has none.
    pub decimals: Option<Decimals>,
}

/// Where a device keeps its number of decimals.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Decimals {
    /// Address on the wire.
    pub address: u16,
    /// The bits that hold the number.
    pub mask: u16,
}

/// The status word of a load cell.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Status {
    /// Address on the wire.
    pub address: u16,
    /// Bits that say the reading is beyond its range.
    #[serde(default)]
    pub saturated_bits: Vec<u8>,
    /// Bits that say the cell or its converter is broken.
    #[serde(default)]
    pub fault_bits: Vec<u8>,
}

/// The output registers of an array, one number a unit, without gaps.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Outputs {
    /// Address on the wire of the first unit's first register.
    pub address: u16,
    /// What each holds.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Which word comes first.
    pub word_order: WordOrder,
    /// Most units that can be read.
    pub count_max: usize,
}

/// A register whose value is known.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Its name in the device's manual.
    pub what: String,
    /// Address on the wire.
    pub address: u16,
    /// What it holds.
    #[serde(rename = "type")]
    pub number: NumberType,
    /// Its value.
    pub value: f64,
}

/// What registers hold.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
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
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum WordOrder {
    /// The one at the lower address.
    Big,
    /// The one at the higher address.
    Little,
}

/// A register map that can't be used.
#[derive(Debug, Error)]
#[error("register map {name}: {problem}")]
pub struct ProfileError {
    name: String,
    problem: String,
}

impl Profile {
    /// Reads a register map; `name` is its file's or its own name in messages.
    ///
    /// # Errors
    /// What is wrong, at its line.
    pub fn parse(name: &str, text: &str) -> Result<Profile, ProfileError> {
        toml::from_str(text).map_err(|error| ProfileError { name: name.to_owned(), problem: error.to_string() })
    }

    /// A register map that came with the program, or none of that name.
    pub fn shipped(name: &str) -> Option<Profile> {
        let (_, text) = SHIPPED.iter().find(|(shipped, _)| *shipped == name)?;
        Profile::parse(name, text).ok() // a test reads every one of them
    }
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
    fn a_misspelt_key_is_named_with_its_line() {
        let error = Profile::parse("mine", "name = \"x\"\nunit = 1\n").unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("unit_id"), "{error}");
    }
}
