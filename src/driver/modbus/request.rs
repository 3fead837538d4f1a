//! How registers are asked for: the framing, and the function.

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
