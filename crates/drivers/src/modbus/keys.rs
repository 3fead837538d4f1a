//! Keys of a register map, table by table.

use super::number::{RegisterNumber, WordOrder};
use super::request::{Function, Transport};
use palpate_document::{Bounds, keys, words};

pub(super) const TRANSPORTS: [(&str, Transport); 2] = [("rtu", Transport::Rtu), ("tcp", Transport::Tcp)];
pub(super) const WORD_ORDERS: [(&str, WordOrder); 2] = [("big", WordOrder::Big), ("little", WordOrder::Little)];
pub(super) const FUNCTIONS: [(&str, Function); 2] = [("holding", Function::Holding), ("input", Function::Input)];
pub(super) const NUMBER_TYPES: [(&str, RegisterNumber); 6] = [
    ("u16", RegisterNumber::U16),
    ("i16", RegisterNumber::I16),
    ("u32", RegisterNumber::U32),
    ("i32", RegisterNumber::I32),
    ("f32", RegisterNumber::F32),
    ("f64", RegisterNumber::F64),
];

const FORCE_PER_UNIT: Bounds = Bounds::within(-1e6, 1e6, "N");
const OFFSET: Bounds = Bounds::within(-1e12, 1e12, "units of the device");
const RANGE: Bounds = Bounds::above(0.0, 1e6, "N");
const VALUE: Bounds = Bounds::within(-1e12, 1e12, "");
/// Largest number of the first register in a manual. Some manuals count holding registers from 40001, and input registers from
/// 30001.
const BASE_MAX: u64 = 40_001;
/// Largest possible address in a manual. The address on the wire has 16 bits.
const ADDRESS_MAX: u64 = BASE_MAX + u16::MAX as u64;
/// One Modbus read carries at most 125 registers (Modbus specification).
pub(super) const REGISTERS_MAX: u64 = 125;

keys! {
    /// The complete register map.
    root {
        name: Text, Refused, "the device's name in messages", "\"Laumas TLB\"";
        transport: Word(&words(&TRANSPORTS)), Refused, "protocol of the device", "\"rtu\"";
        unit_id: Whole(0, 255), Refused, "its Modbus unit (slave) ID", "1";
        deadline_ms: Whole(1, 60_000), Refused, "longest wait for an answer", "200";
        rest_ms: Whole(0, 1000), or_whole(0), "shortest pause between an answer and the next request; \
            on a serial line at least 3.5 characters, and at least 1.75 ms above 19,200 baud", "20";
        registers_max: Whole(1, REGISTERS_MAX), or_whole(REGISTERS_MAX), "largest number of registers per request", "32";
        address_base: Whole(0, BASE_MAX), or_whole(0), "number of the first register in its manual", "40001";
        force: Table(&force::KEYS), Allowed, "register of a load cell's force";
        status: Table(&status::KEYS), Allowed, "status of a load cell";
        outputs: Table(&outputs::KEYS), Allowed, "registers of an array's outputs, one number per unit, without gaps";
        probe: Tables(&probe::KEYS), Allowed, "registers with a known value, which confirm that the map fits";
    }
}

keys! {
    /// Address and content of a number.
    register {
        function: Word(&words(&FUNCTIONS)), or_word("holding"), "registers that are read", "\"input\"";
        address: Whole(0, ADDRESS_MAX), Refused, "address of its first register, numbered as in the manual", "40008";
        number_type = "type": Word(&words(&NUMBER_TYPES)), Refused, "number format of the registers", "\"i32\"";
        word_order: Word(&words(&WORD_ORDERS)), Allowed,
            "`big`: the high word is at the lower address; not used for one register", "\"big\"";
        swap_bytes: Flag, or_flag(false), "the two bytes of each register are swapped", "true";
        mask: Whole(1, u32::MAX as u64), Allowed, "bits of a whole number that are used; without it, all", "255";
        shift: Whole(0, 31), or_whole(0), "how far these are shifted down", "4";
    }
}

keys! {
    /// `[force]`
    force {
        newton_per_unit: Number(FORCE_PER_UNIT), Refused, "N per count of the device, before its decimals", "0.001";
        offset: Number(OFFSET), or(0.0), "reading of the device without force", "12.0";
        range_n: Number(RANGE), Allowed, "largest force it can measure; a larger reading is invalid", "50.0";
        decimals: Table(&decimals::KEYS), Allowed, "register with the number of decimals of its integer";
        sign: Table(&sign::KEYS), Allowed, "sign bit of a magnitude, read together with the force";
        axes: Flag, or_flag(false),
            "a cell with three axes: forces along its x, y and z, one after another from `address` on", "true";
    }
    as register { function, address, number_type, word_order, swap_bytes, mask, shift }
}

keys! {
    /// `decimals` of `[force]`.
    decimals {
        mask: Whole(1, u16::MAX as u64), Refused, "bits that are used", "7";
        shift: Whole(0, 15), or_whole(0), "how far these are shifted down", "4";
    }
    as register { address }
}

keys! {
    /// `sign` of `[force]`.
    sign {
        bit: Whole(0, 15), Refused, "0 (least significant) to 15", "7";
    }
    as register { address }
}

keys! {
    /// `[status]`
    status {
        saturated_bits: Wholes(0, 15), Allowed, "bits that report a reading out of range", "[2, 3]";
        fault_bits: Wholes(0, 15), Allowed, "bits that report a fault of the cell or its converter", "[0, 1]";
    }
    as register { address }
}

keys! {
    /// `[outputs]`
    outputs {
        count_max: Whole(1, REGISTERS_MAX), Refused, "largest number of outputs per reading", "14";
    }
    as register { function, address, number_type, word_order, swap_bytes, mask, shift }
}

keys! {
    /// `[[probe]]`
    probe {
        what: Text, Refused, "its name in the device's manual", "\"PRODUCT_ID\"";
        value: Number(VALUE), Refused, "its value", "7.0";
    }
    as register { function, address, number_type, word_order, swap_bytes, mask, shift }
}

#[cfg(test)]
mod tests {
    use crate::modbus::{KEYS, Profile};
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn register_map_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&KEYS, |text| drop(Profile::parse("map.toml", text)));
    }
}
