//! Content of registers, and how a number is read from them.

use palpate_core::quantity::Range;

/// Content of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegisterNumber {
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
    /// Four registers, IEEE 754 double.
    F64,
}

/// Order of two registers: which register is the more significant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordOrder {
    /// The register at the lower address.
    Big,
    /// The register at the higher address.
    Little,
}

/// Encoding of a device's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoding {
    /// Content of the registers.
    pub number: RegisterNumber,
    /// Order of the words.
    pub word_order: WordOrder,
    /// Whether the low byte of each register comes first. In the Modbus specification the high byte comes first.
    pub swap_bytes: bool,
    /// Used bits of an integer; `None`: all bits.
    pub mask: Option<u32>,
    /// Number of bits by which the masked value is shifted to the right.
    pub shift: u8,
}

impl RegisterNumber {
    /// Number of registers for one number.
    pub fn registers(self) -> u16 {
        match self {
            RegisterNumber::U16 | RegisterNumber::I16 => 1,
            RegisterNumber::U32 | RegisterNumber::I32 | RegisterNumber::F32 => 2,
            RegisterNumber::F64 => 4,
        }
    }

    /// Whether the number is an integer, so that single bits have a meaning.
    pub fn is_whole(self) -> bool {
        !matches!(self, RegisterNumber::F32 | RegisterNumber::F64)
    }
}

impl Encoding {
    /// Returns the encoding of a number in the specification's own byte order, with all bits used.
    pub fn plain(number: RegisterNumber, word_order: WordOrder) -> Self {
        Encoding { number, word_order, swap_bytes: false, mask: None, shift: 0 }
    }

    /// Number of registers for one number.
    pub fn registers(&self) -> u16 {
        self.number.registers()
    }

    /// Returns the registers of a number, as [`decode`](Self::decode) reads them. One beyond the ends of its type becomes that end.
    pub fn encode(&self, number: f64) -> Vec<u16> {
        let whole = number.round();
        let bits = match (self.mask, self.number) {
            (Some(mask), _) => u64::from((whole as u32).min(mask >> self.shift) << self.shift & mask),
            (None, RegisterNumber::U16) => u64::from(whole as u16),
            (None, RegisterNumber::I16) => u64::from(whole as i16 as u16),
            (None, RegisterNumber::U32) => u64::from(whole as u32),
            (None, RegisterNumber::I32) => u64::from(whole as i32 as u32),
            (None, RegisterNumber::F32) => u64::from((number as f32).to_bits()),
            (None, RegisterNumber::F64) => number.to_bits(),
        };
        let word = |at: u16| (bits >> (16 * at)) as u16;
        let swapped = |word: u16| if self.swap_bytes { word.swap_bytes() } else { word };
        let low_first = (0..self.registers()).map(word).map(swapped);
        match self.word_order {
            WordOrder::Little => low_first.collect(),
            WordOrder::Big => low_first.rev().collect(),
        }
    }

    /// Returns the ends of the whole numbers that the registers can hold; `None` for others.
    pub fn range(&self) -> Option<Range> {
        let (min, max) = match (self.mask, self.number) {
            (Some(mask), _) => (0.0, f64::from(mask >> self.shift)),
            (None, RegisterNumber::U16) => (0.0, f64::from(u16::MAX)),
            (None, RegisterNumber::I16) => (f64::from(i16::MIN), f64::from(i16::MAX)),
            (None, RegisterNumber::U32) => (0.0, f64::from(u32::MAX)),
            (None, RegisterNumber::I32) => (f64::from(i32::MIN), f64::from(i32::MAX)),
            (None, RegisterNumber::F32 | RegisterNumber::F64) => return None,
        };
        Some(Range { min, max })
    }

    /// Returns the number in some registers; `None` if there are too few.
    pub(crate) fn decode(&self, words: &[u16]) -> Option<f64> {
        let words = words.get(..usize::from(self.registers()))?;
        let word = |word: &u16| u64::from(if self.swap_bytes { word.swap_bytes() } else { *word });
        let joined = |bits: u64, word: u64| bits << 16 | word;
        let bits = match self.word_order {
            WordOrder::Big => words.iter().map(word).fold(0, joined),
            WordOrder::Little => words.iter().rev().map(word).fold(0, joined),
        };
        if let Some(mask) = self.mask {
            return Some(f64::from((bits as u32 & mask) >> self.shift));
        }
        Some(match self.number {
            RegisterNumber::U16 | RegisterNumber::U32 => bits as f64,
            RegisterNumber::I16 => f64::from(bits as u16 as i16),
            RegisterNumber::I32 => f64::from(bits as u32 as i32),
            RegisterNumber::F32 => f64::from(f32::from_bits(bits as u32)),
            RegisterNumber::F64 => f64::from_bits(bits),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_are_decoded_in_either_word_order() {
        let decode = |number, order, words: &[u16]| Encoding::plain(number, order).decode(words);
        assert_eq!(decode(RegisterNumber::I32, WordOrder::Big, &[0, 132]), Some(132.0));
        assert_eq!(decode(RegisterNumber::I32, WordOrder::Big, &[0xFFFF, 0xFFFE]), Some(-2.0));
        assert_eq!(decode(RegisterNumber::I32, WordOrder::Little, &[500, 0]), Some(500.0));
        assert_eq!(decode(RegisterNumber::F32, WordOrder::Big, &[0x40E0, 0]), Some(7.0));
        assert_eq!(decode(RegisterNumber::I16, WordOrder::Big, &[0xFFFF]), Some(-1.0));
        assert_eq!(decode(RegisterNumber::F64, WordOrder::Little, &[0, 0, 0, 0x401C]), Some(7.0));
        assert_eq!(decode(RegisterNumber::U32, WordOrder::Big, &[1]), None);
    }

    #[test]
    fn bytes_can_be_swapped_and_bits_picked_out() {
        let plain = Encoding::plain(RegisterNumber::U32, WordOrder::Big);
        let swapped = Encoding { swap_bytes: true, ..plain };
        assert_eq!(swapped.decode(&[0x3412, 0x7856]), Some(f64::from(0x1234_5678)));
        // a 17-bit value beside status bits
        let field = Encoding { mask: Some(0x01FF_FF00), shift: 8, ..plain };
        assert_eq!(field.decode(&[0xFE01, 0x2C7F]), Some(f64::from(0x0_012C)));
    }

    #[test]
    fn a_number_beyond_its_type_is_its_end() {
        let encode = |number, value| Encoding::plain(number, WordOrder::Big).encode(value);
        assert_eq!(encode(RegisterNumber::I16, -1e9), [0x8000]);
        assert_eq!(encode(RegisterNumber::U32, 1e12), [0xFFFF, 0xFFFF]);
        let field = Encoding { mask: Some(0x70), shift: 4, ..Encoding::plain(RegisterNumber::U16, WordOrder::Big) };
        assert_eq!([field.encode(3.0), field.encode(9.0), field.encode(-1.0)], [[0x30], [0x70], [0]]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn a_number_is_decoded_as_it_was_encoded(
            bits in any::<u32>(),
            kind in 0..7usize,
            is_little in any::<bool>(),
            swap_bytes in any::<bool>(),
        ) {
            let (number, value) = [
                (RegisterNumber::U16, f64::from(bits as u16)),
                (RegisterNumber::I16, f64::from(bits as i16)),
                (RegisterNumber::U32, f64::from(bits)),
                (RegisterNumber::I32, f64::from(bits as i32)),
                (RegisterNumber::F32, f64::from(bits as i32 as f32 / 1024.0)),
                (RegisterNumber::F64, f64::from(bits) / 3.0),
                (RegisterNumber::U32, f64::from(bits & 0x3FF)),
            ][kind];
            let mask = (kind == 6).then_some(0x3FF << 5);
            let word_order = if is_little { WordOrder::Little } else { WordOrder::Big };
            let encoding = Encoding { number, word_order, swap_bytes, mask, shift: if kind == 6 { 5 } else { 0 } };
            prop_assert_eq!(encoding.decode(&encoding.encode(value)), Some(value));
        }
    }
}
