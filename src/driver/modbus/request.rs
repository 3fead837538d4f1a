//! Requests for registers: the framing and the function.

/// Framing of Modbus on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Serial line, CRC and silence.
    Rtu,
    /// TCP, with a header that numbers the transactions.
    Tcp,
}

/// Function that reads registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Function code 3.
    Holding,
    /// Function code 4.
    Input,
}

impl Function {
    /// Returns the other function, for comparison: an answer to one function can't be an answer to the other.
    pub fn other(self) -> Function {
        match self {
            Function::Holding => Function::Input,
            Function::Input => Function::Holding,
        }
    }
}
