//! Keys of a rig's `[scene]`, table by table. A physical term exists only if the scene names it.

use super::keys::tilt_mm_per_mm;
use palpate_core::mechanics::MOST_POISSON_RATIO;
use palpate_document::{Bounds, keys, words};
use palpate_sim::scene::{CorruptSamples, FaultKind, GlitchKind, NoiseOf, SideAxes};

pub(super) const ROTATION: Bounds = Bounds::within(-180.0, 180.0, "degrees");
const STIFFNESS: Bounds = Bounds::above(0.0, 100_000.0, "N/mm");
const STIFFER: Bounds = Bounds::within(0.0, 50.0, "%");
const TIME: Bounds = Bounds::within(0.01, 86_400.0, "s");
const PLACE: Bounds = Bounds::within(-100.0, 100.0, "mm");
const HEIGHT: Bounds = Bounds::within(0.0, 10.0, "mm");
const RADIUS: Bounds = Bounds::within(0.0, 1000.0, "mm");
const FORCE: Bounds = Bounds::within(0.0, 100.0, "N");
const OFFSET: Bounds = Bounds::within(-100.0, 100.0, "N");
const LAG: Bounds = Bounds::within(0.0, 1000.0, "ms");
const LATENCY: Bounds = Bounds::within(0.0, 10_000.0, "ms");
const DEGREES: &str = "degrees Celsius";
const TEMPERATURE: Bounds = Bounds::within(-100.0, 200.0, DEGREES);
const PER_DEGREE: Bounds = Bounds::within(-1.0, 1.0, "1/degree");
const PERCENT: Bounds = Bounds::within(0.0, 100.0, "%");
/// Limits of reading units: 1 is the reading for 1 N directly above.
const READING: Bounds = Bounds::within(-1000.0, 1000.0, "");

pub(super) const NOISE_OF: [(&str, NoiseOf); 2] = [("full-scale", NoiseOf::FullScale), ("reading", NoiseOf::Reading)];

/// Kind of a unit's fault as named in the text, without its size.
#[derive(Clone, Copy)]
pub(super) enum NamedFault {
    Dead,
    Stuck,
    Clipped,
    Drifted,
}

pub(super) const TAXEL_FAULTS: [(&str, NamedFault); 4] = [
    ("dead", NamedFault::Dead),
    ("stuck", NamedFault::Stuck),
    ("clipped", NamedFault::Clipped),
    ("drifted", NamedFault::Drifted),
];

keys! {
    /// `[scene]`
    scene {
        elastomer: Table(&elastomer::KEYS), Allowed, "elastomer over the taxels; without it they read nothing";
        indenter: Table(&indenter::KEYS), Allowed, "shape of the indenter's tip; without it a point";
        taxels: Table(&taxels::KEYS), Allowed, "differences of the taxels from identical points";
        taxel_noise: Table(&taxel_noise::KEYS), Allowed, "random error that each contact adds to a unit's output";
        hysteresis: Table(&hysteresis::KEYS), Allowed, "difference of a unit's output between unloading and loading";
        taxel_fault: Tables(&taxel_fault::KEYS), Allowed, "broken units";
        taxel_creep: Tables(&taxel_creep::KEYS), Allowed, "slow growth of a unit's output under a load; it acts after the lag";
        taxel_lag_s: Number(above(0.0, 60.0, "s")), Allowed, "time constant with which a unit's output follows its load; without it, at once", "0.05";
        wear: Table(&wear::KEYS), Allowed, "change of all units by each contact; a resumed run begins without wear";
        temperature: Table(&temperature::KEYS), Allowed, "temperature over time, and its effects";
        converter: Table(&converter::KEYS), Allowed, "resolution and range of the converter";
        contact: Table(&contact::KEYS), Refused, "relaxed force as a function of depth";
        relaxation: Tables(&relaxation::KEYS), Allowed, "additional force after a sudden load, and its decay: the creep of the specimen";
        friction: Table(&friction::KEYS), Allowed, "friction between tip and specimen; without it none";
        mounting: Table(&mounting::KEYS), Allowed, "true position of the specimen relative to the rig's [frame]";
        surface: Table(&surface::KEYS), Allowed, "shape of the surface; without it flat and level";
        stiffness: Table(&stiffness::KEYS), Allowed, "variation of the stiffness over the surface";
        stage: Table(&stage::KEYS), Allowed, "differences between the controller's motions and the stage's";
        load_cell: Table(&load_cell::KEYS), Allowed, "imperfections of the load cell";
        latency_ms: Table(&latency_ms::KEYS), Allowed, "shortest and longest time from a request to its answer";
        fault: Tables(&fault::KEYS), Allowed, "faults, and when they occur";
    }
}

keys! {
    /// `elastomer` of the scene.
    elastomer {
        depth_mm: Number(above(0.0, 1000.0, "mm")), Refused, "depth of the taxels", "5.0";
        bonded_poisson_ratio: Number(within(0.0, MOST_POISSON_RATIO, "")), Allowed,
            "Poisson's ratio of a layer bonded to a rigid base; without it, a half-space", "0.49";
    }
}

keys! {
    /// `indenter` of the scene.
    indenter {
        radius_mm: Number(RADIUS), or(0.0), "radius of its flat end", "0.5";
    }
}

keys! {
    /// `taxels` of the scene.
    taxels {
        radius_mm: Number(RADIUS), or(0.0), "radius of the disc that a taxel averages over", "1.0";
        gain_spread_percent: Number(within(0.0, 90.0, "%")), or(0.0), "largest difference of gains from the nominal, + and -", "20.0";
        place_spread_mm: Number(within(0.0, 10.0, "mm")), or(0.0), "standard deviation of positions along x and y", "0.1";
        depth_spread_percent: Number(within(0.0, 30.0, "%")), or(0.0), "standard deviation of depths", "5.0";
        baseline: Number(READING), or(0.0), "output of every unit without a load", "0.02";
        shear: Flag, or_flag(false), "outputs 2 and 3 of a unit are shear stresses along x and y; only for a point load on a half-space", "true";
    }
}

keys! {
    /// `taxel_noise` of the scene.
    taxel_noise {
        repeatability_percent: PerUnit(PERCENT), Refused, "repeatability of each unit, which is three standard deviations of the error of a contact", "[1.6, 3.74, 2.19]";
        of: Word(&words(&NOISE_OF)), or_word("full-scale"), "reference of the percentages", "\"reading\"";
        floor: Number(within(0.0, 1000.0, "")), or(0.0), "standard deviation of an error that doesn't depend on the load", "0.001";
    }
}

keys! {
    /// `hysteresis` of the scene.
    hysteresis {
        hysteresis_percent: PerUnit(PERCENT), Refused, "largest difference between the two branches, in % of full scale",
            "[4.11, 2.29, 2.88]";
    }
}

keys! {
    /// `[[scene.taxel_fault]]`
    taxel_fault {
        unit: Whole(1, u16::MAX as u64), Refused, "number of the unit, from 1", "5";
        kind: Word(&words(&TAXEL_FAULTS)), Refused, "kind of the fault", "\"dead\"";
    }
    by kind {
        stuck {
            reading: Number(READING), Refused, "its constant output", "3.0";
        }
        clipped {
            reading: Number(READING), Refused, "its largest output", "0.3";
        }
        drifted {
            gain_percent: Number(within(-100.0, 1000.0, "%")), Refused, "factor on its output", "-10.0";
        }
    }
}

keys! {
    /// `[[scene.taxel_creep]]`
    taxel_creep {
        share: Number(within(-1.0, 10.0, "")), Refused, "growth of the output after a long time as a share; all shares add up to over -1", "0.2";
        time_s: Number(TIME), Refused, "time of 63 % of it; at least twice `taxel_lag_s`", "30.0";
    }
}

keys! {
    /// `wear` of the scene.
    wear {
        gain_per_press: Number(within(-1.0, 1.0, "")), or(0.0), "change of the gain by each contact, as a share of the first gain", "-1e-5";
        zero_per_press: Number(within(-1.0, 1.0, "")), or(0.0), "change of the output without a load by each contact", "2e-6";
        radius_mm: Number(Bounds::above(0.0, 1000.0, "mm")), Allowed, "distance over which a contact wears the gain; without it, the whole skin", "2.0";
    }
}

keys! {
    /// `temperature` of the scene.
    temperature {
        mean_c: Number(TEMPERATURE), Refused, "temperature when the rig is opened", "23.0";
        amplitude_c: Number(within(0.0, 100.0, DEGREES)), or(0.0), "amplitude of a sine change over time", "2.0";
        period_s: Number(TIME), or(3600.0), "period of this sine", "3600.0";
        drift_c_h: Number(within(-100.0, 100.0, "degrees Celsius/h")), or(0.0), "drift rate", "0.5";
        reference_c: Number(TEMPERATURE), Allowed, "temperature without effects; without it `mean_c`", "20.0";
        taxel_zero_per_c: Number(within(-100.0, 100.0, "1/degree")), or(0.0), "change of all outputs without a load", "0.001";
        taxel_gain_per_c: Number(PER_DEGREE), or(0.0), "change of all units' gains as a share", "-0.002";
        load_cell_zero_n_per_c: Number(within(-10.0, 10.0, "N/degree")), or(0.0), "change of the load cell's reading without a load", "0.002";
        load_cell_gain_per_c: Number(PER_DEGREE), or(0.0), "change of the load cell's gain as a share", "0.0005";
    }
}

keys! {
    /// `converter` of the scene.
    converter {
        bits: Whole(1, 32), Refused, "number of bits", "16";
        range: Number(above(0.0, 1000.0, "")), Refused, "its largest reading, + and -", "10.0";
    }
}

keys! {
    /// `contact` of the scene.
    contact {
        linear_n_mm: Number(STIFFNESS), Refused, "linear part of the force", "1.1";
        quadratic_n_mm2: Number(within(0.0, 100_000.0, "N/mm^2")), or(0.0), "quadratic part of the force", "0.1556";
        toe_mm: Number(within(0.0, 10.0, "mm")), or(0.0), "depth after which the whole tip is in contact", "0.01";
    }
}

/// Differences of the axes x and y of a cell with three axes.
pub(super) const SIDEWAYS: [(&str, SideAxes); 4] = [
    ("as stated", SideAxes::AsStated),
    ("swapped", SideAxes::Swapped),
    ("mirrored", SideAxes::Mirrored),
    ("dead x", SideAxes::Dead),
];

keys! {
    /// `friction` of the scene.
    friction {
        sticking: Number(within(0.0, 10.0, "")), Refused, "largest force sideways per force along z while the tip sticks", "0.8";
        sliding: Number(within(0.0, 10.0, "")), Refused, "the same after a slip; at most `sticking`", "0.6";
        stiffness_n_mm: Number(STIFFNESS), Refused, "force sideways per distance while the tip sticks", "1.0";
    }
}

keys! {
    /// One entry of `relaxation` of the scene.
    relaxation {
        share: Number(within(0.0, 10.0, "")), Refused, "additional force as a share of the sudden load", "0.05";
        time_s: Number(TIME), Refused, "time of its decay to 37 %", "0.3";
    }
}

keys! {
    /// `mounting` of the scene.
    mounting {
        x_mm: Number(PLACE), or(0.0), "x of its origin", "0.6";
        y_mm: Number(PLACE), or(0.0), "y of its origin", "-0.4";
        z_mm: Number(PLACE), or(0.0), "how much deeper its surface is", "0.1";
        rotation_deg: Number(ROTATION), or(0.0), "its rotation, from x towards y", "3.0";
    }
}

keys! {
    /// `surface` of the scene.
    surface {
        tilt_mm: Number(HEIGHT), or(0.0), "largest deviation of its plane in the loading area", "0.2";
        tilt_mm_per_mm: Table(&tilt_mm_per_mm::KEYS), Allowed, "further tilt of its plane, with the cosine of depth and force";
        bumps_mm: Number(HEIGHT), Allowed, "largest height of its bumps, + and -; without it, no bumps", "0.005";
        bumps_wavelength_mm: Range(within(0.1, 1000.0, "mm")), or_range(6.0, 12.0),
            "smallest and largest wavelength of the bumps", "[6.0, 12.0]";
        roughness_mm: Number(HEIGHT), Allowed, "standard deviation of the random height that each spot of 1 um has; without it 0", "0.001";
        wave_mm: Number(HEIGHT), or(0.0), "amplitude of a sine motion over time", "0.005";
        wave_s: Number(TIME), or(60.0), "period of this sine", "60.0";
    }
}

keys! {
    /// `stiffness` of the scene.
    stiffness {
        smooth_percent: Number(STIFFER), or(0.0), "largest smooth variation, + and -", "6.0";
        white_percent: Number(STIFFER), or(0.0), "standard deviation of the random value that each spot of 1 um has", "0.5";
    }
}

keys! {
    /// `stage` of the scene.
    stage {
        servo_ms: Number(LAG), or(0.0), "delay behind its controller's profile", "7.0";
        quantum_mm: Number(within(0.0, 1.0, "mm")), or(0.0), "targets are rounded to a multiple of this", "0.0001";
        backlash_mm: Number(within(0.0, 1.0, "mm")), or(0.0), "backlash of z that its read-back doesn't show", "0.003";
    }
}

keys! {
    /// `load_cell` of the scene.
    load_cell {
        noise_n: Number(FORCE), or(0.0), "standard deviation of one conversion", "0.003";
        noise_ahead_n: Number(FORCE), or(0.0), "standard deviation of the noise after its low-pass filter", "0.002";
        offset_n: Number(OFFSET), or(0.0), "its reading without a load", "0.0";
        drift_n_min: Number(within(-10.0, 10.0, "N/min")), or(0.0), "drift rate of its zero", "0.03";
        wander_n: Number(FORCE), or(0.0), "amplitude of a sine drift of its zero", "0.005";
        wander_s: Number(TIME), or(25.0), "period of this sine", "25.0";
        hum_n: Number(FORCE), or(0.0), "amplitude of the mains interference in its readings", "0.01";
        hum_hz: Number(within(1.0, 1000.0, "Hz")), or(50.0), "frequency of the hum", "49.8";
        gain_error_percent: Number(within(-300.0, 300.0, "%")), or(0.0), "factor on its readings", "1.0";
        transport_ms: Number(LAG), or(0.0), "delay from a conversion until it can be read", "2.0";
        low_pass_hz: Number(within(0.1, 1e6, "Hz")), Allowed, "cut-off frequency of its low-pass filter; without it, no filter",
            "100.0";
        stiffness_n_mm: Number(STIFFNESS), Allowed, "stiffness of the cell with the indenter; without it, rigid", "10.0";
        tool_kg: Number(within(0.0, 100.0, "kg")), or(0.0), "mass that hangs from it and moves with the stage", "0.2";
        crosstalk_percent: Number(within(-50.0, 50.0, "%")), or(0.0), "part of a force that each other of three axes reads too", "2.0";
        sideways: Word(&words(&SIDEWAYS)), or_word("as stated"), "how x and y of three axes differ from what the rig states", "\"swapped\"";
        glitches: Table(&glitches::KEYS), Allowed, "corrupt samples, which no force caused; a sample is a conversion that is read";
    }
}

keys! {
    /// `glitches` of the load cell. The kinds are counts of 24 bits, as users of the HX711 report them.
    glitches {
        kind: Word(&words(&GlitchKind::ALL)), Refused, "what such a sample is: the count -1, 2^24 - 1 or 2^23 - 1, another sign bit, or low bits of 1",
            "\"minus-one\"";
        share: Number(within(0.0, 1.0, "")), Refused, "share of the samples", "0.004";
        in_a_row: Whole(1, 1_000_000), or_whole(1), "successive samples of each event", "2";
        range_n: Number(Bounds::above(0.0, 100_000.0, "N")), or(CorruptSamples::USUAL_RANGE_N), "force of 2^23 counts; a device that sends counts has its own", "20.0";
        from_s: Number(within(0.0, 1e9, "s")), or(0.0), "start of the events, from the opening of the rig", "12.0";
        for_s: Number(within(0.0, 1e9, "s")), Allowed, "time in which events begin; without it, always", "1.0";
    }
}

keys! {
    /// `latency_ms` of the scene. The defaults: an ESP301 answers in 5 to 20 ms. A transmitter at 115200 baud needs 1.5 ms for
    /// the bytes of an exchange, and two silences of 1.75 ms minus the driver's own waiting time. A T7 answers in 1 to 2 ms.
    latency_ms {
        stage: Range(LATENCY), or_range(5.0, 20.0), "controller of the stage", "[5.0, 20.0]";
        load_cell: Range(LATENCY), or_range(2.0, 3.0), "transmitter of the load cell", "[2.0, 3.0]";
        array: Range(LATENCY), or_range(1.0, 2.0), "converter of the array", "[1.0, 2.0]";
        spikes: Table(&spikes::KEYS), Allowed, "exchanges with the stage that take much longer than others";
    }
}

keys! {
    /// `spikes` of the latencies.
    spikes {
        share: Number(within(0.0, 1.0, "")), Refused, "share of these exchanges", "0.02";
        ms: Number(LATENCY), Refused, "additional time of these exchanges", "200.0";
    }
}

keys! {
    /// `[[scene.fault]]`
    fault {
        kind: Word(&words(&FaultKind::ALL)), Refused, "what goes wrong", "\"stuck\"";
        from_s: Number(within(0.0, 1e9, "s")), Refused, "start of the fault, from the opening of the rig", "12.0";
    }
    by kind {
        saturated {
            value: Number(FORCE), Allowed, "largest reading of the load cell; without it 0.8 N", "0.8";
        }
        hard_contact = "hard-contact" {
            value: Number(STIFFNESS), Allowed, "stiffness from the next contact; without it 20 N/mm", "20.0";
        }
        array_lost = "array-lost" {
            value: Number(TIME), Allowed, "time for which the array is silent; without it for ever", "2.5";
        }
        scaled_outputs = "scaled-outputs" {
            value: Number(within(0.0, 1e6, "times")), Allowed, "factor on the array's outputs; without it 2", "1.3";
        }
        slow_stage = "slow-stage" {
            value: Number(LATENCY), Allowed, "additional time of each exchange; the default is 200 ms", "200.0";
        }
        noisy {
            value: Number(within(0.0, 1e6, "times")), Allowed, "factor on the noise; without it 10", "10.0";
        }
        drifted_zero = "drifted-zero" {
            value: Number(OFFSET), Allowed, "offset added to the load cell's readings; without it -0.5 N", "-0.5";
        }
        lost_gain = "lost-gain" {
            value: Number(within(0.0, 10.0, "times")), Allowed, "factor on the load cell's readings; without it 0.5", "0.65";
        }
        rolls_over = "rolls-over" {
            value: Number(FORCE), Allowed, "reading above which the load cell's count turns negative; without it 0.8 N", "0.8";
        }
    }
}
