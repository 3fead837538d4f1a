//! What registers hold, and how a number is read from them.

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
    /// Four registers, IEEE 754 double.
    F64,
}

/// Which of two registers is the more significant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordOrder {
    /// The one at the lower address.
    Big,
    /// The one at the higher address.
    Little,
}

/// How a device writes its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoding {
    /// What the registers hold.
    pub number: NumberType,
    /// Which word comes first.
    pub word_order: WordOrder,
    /// Whether the low byte of each register comes first; the Modbus specification has the high one there.
    pub swap_bytes: bool,
    /// The bits of a whole number that count; none: all.
    pub mask: Option<u32>,
    /// How far what is left by the mask is moved to the right.
    pub shift: u8,
}

impl NumberType {
    /// How many registers one number takes.
    pub fn registers(self) -> u16 {
        match self {
            NumberType::U16 | NumberType::I16 => 1,
            NumberType::U32 | NumberType::I32 | NumberType::F32 => 2,
            NumberType::F64 => 4,
        }
    }

    /// Whether it has bits that mean something by themselves.
    pub fn is_whole(self) -> bool {
        !matches!(self, NumberType::F32 | NumberType::F64)
    }
}

impl Encoding {
    /// A number of the specification's own byte order, all bits of it.
    pub fn plain(number: NumberType, word_order: WordOrder) -> Self {
        Encoding { number, word_order, swap_bytes: false, mask: None, shift: 0 }
    }

    /// How many registers one number takes.
    pub fn registers(&self) -> u16 {
        self.number.registers()
    }

    /// The number in some registers, or none if there are too few.
    pub fn decode(&self, words: &[u16]) -> Option<f64> {
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
            NumberType::U16 | NumberType::U32 => bits as f64,
            NumberType::I16 => f64::from(bits as u16 as i16),
            NumberType::I32 => f64::from(bits as u32 as i32),
            NumberType::F32 => f64::from(f32::from_bits(bits as u32)),
            NumberType::F64 => f64::from_bits(bits),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decoded_in_either_word_order() {
        let decode = |number, order, words: &[u16]| Encoding::plain(number, order).decode(words);
        assert_eq!(decode(NumberType::I32, WordOrder::Big, &[0, 132]), Some(132.0));
        assert_eq!(decode(NumberType::I32, WordOrder::Big, &[0xFFFF, 0xFFFE]), Some(-2.0));
        assert_eq!(decode(NumberType::I32, WordOrder::Little, &[500, 0]), Some(500.0));
        assert_eq!(decode(NumberType::F32, WordOrder::Big, &[0x40E0, 0]), Some(7.0));
        assert_eq!(decode(NumberType::I16, WordOrder::Big, &[0xFFFF]), Some(-1.0));
        assert_eq!(decode(NumberType::F64, WordOrder::Little, &[0, 0, 0, 0x401C]), Some(7.0));
        assert_eq!(decode(NumberType::U32, WordOrder::Big, &[1]), None);
    }

    #[test]
    fn bytes_can_be_swapped_and_bits_picked_out() {
        let plain = Encoding::plain(NumberType::U32, WordOrder::Big);
        let swapped = Encoding { swap_bytes: true, ..plain };
        assert_eq!(swapped.decode(&[0x3412, 0x7856]), Some(f64::from(0x1234_5678)));
        // a 17-bit value beside status bits
        let field = Encoding { mask: Some(0x01FF_FF00), shift: 8, ..plain };
        assert_eq!(field.decode(&[0xFE01, 0x2C7F]), Some(f64::from(0x0_012C)));
    }
}
