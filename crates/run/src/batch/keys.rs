//! Keys of a batch file, table by table.

use super::SERIALS_MAX;
use palpate_document::notify::NOTIFY;
use palpate_document::{Bounds, keys};

/// Longest wait of the sensors on the bench before they are pressed, s.
const HOUR_S: f64 = 3600.0;
const OFFSET: Bounds = Bounds::within(-1000.0, 1000.0, "mm");

/// Largest numbers: of a serial number, of its digits, and of sensors between two measurements of the reference sensor.
pub(super) const NUMBER_MAX: u64 = 999_999_999;
const DIGITS_MAX: u64 = 9;
const EVERY_MAX: u64 = SERIALS_MAX as u64;

keys! {
    /// The complete batch file.
    root {
        name: Text, Refused, "name of the batch, and of its folder", "\"2026-11-23\"";
        design: Text, Refused, "design of the sensors", "\"skin-3x3\"";
        prior: Table(&prior::KEYS), Allowed, "the design's prior; without it, every sensor is calibrated alone";
        rig: Text, Refused, "rig file: a path relative to this file, or the name of a shipped rig", "\"rig.toml\"";
        recipes: Texts, Refused,
            "recipe files, named in the same way: every sensor gets the first; the next ones are for sensors that need more presses",
            "[\"calibrate.toml\"]";
        accept: Text, Allowed, "file with the acceptance rule, instead of the first recipe's", "\"accept.toml\"";
        serials: Either(&[Table(&serials::KEYS), Texts]), Refused, "serial numbers of the sensors, or how they are counted",
            "[\"A-01\", \"A-02\"]";
        operator: Text, Allowed, "name of the operator, unless the command line states it", "\"Ada\"";
        bench: Text, Allowed, "name of the bench; without it, that of the rig file", "\"bench-2\"";
        seed: Whole(0, NUMBER_MAX), or_whole(1), "random seed of a simulated batch", "7";
        warm_up_s: Number(within(0.0, HOUR_S, "s")), or(0.0),
            "time between the last serial number and the first motion, in which the sensors reach the bench's temperature", "60.0";
        reference: Table(&reference::KEYS), Allowed, "reference sensor, which shows whether the bench has changed";
        nest: Tables(&nest::KEYS), Allowed, "places of a tray, calibrated one after another; without them, one sensor at a time";
        typical: Table(&typical::KEYS), Allowed, "errors of a typical sensor, from which the chance of no decision is computed";
        notify: Table(&NOTIFY), Allowed, "program that is started for events";
    }
}

keys! {
    /// `[prior]`
    prior {
        runs: Texts, Refused, "run folders of full calibrations of other sensors of the design, one for each sensor, relative to this file",
            "[\"full/A-001\", \"full/A-002\", \"full/A-003\"]";
        enough_mm: Number(above(0.0, 1000.0, "mm")), Allowed,
            "expected mean location error above which the next recipe is pressed too", "0.25";
    }
}

keys! {
    /// `serials`, counted.
    serials {
        prefix: Text, Refused, "beginning of each serial number", "\"A-\"";
        first: Whole(0, NUMBER_MAX), Refused, "the first number", "1";
        last: Whole(0, NUMBER_MAX), Refused, "the last number", "30";
        digits: Whole(1, DIGITS_MAX), or_whole(1), "least number of digits, filled with zeros", "3";
    }
}

keys! {
    /// `[reference]`
    reference {
        serial: Text, Refused, "its serial number", "\"REF-1\"";
        every: Whole(1, EVERY_MAX), or_whole(2), "number of sensors after which it is measured again", "10";
    }
}

keys! {
    /// `[[nest]]`
    nest {
        name: Text, Refused, "name of the nest", "\"left\"";
        offset_mm: Table(&offset_mm::KEYS), Refused, "distance of its specimen's origin from the rig's `frame.origin_mm`, along the stage's axes";
    }
}

keys! {
    /// `offset_mm` of a nest.
    offset_mm {
        x: Number(OFFSET), Refused, "along the stage's x", "10.0";
        y: Number(OFFSET), Refused, "along the stage's y", "0.0";
    }
}

keys! {
    /// `typical`
    typical {
        location_mean_mm: Number(above(0.0, 1000.0, "mm")), Allowed, "mean location error", "0.8";
        force_mean_n: Number(above(0.0, 100.0, "N")), Allowed, "mean force error", "0.08";
    }
}
