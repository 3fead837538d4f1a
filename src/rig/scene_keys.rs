//! The keys of a rig's `[scene]`, table by table: each physical term is there because it is named.

use crate::document::{Bounds, keys, words};
use crate::mechanics::MOST_POISSON_RATIO;
use crate::scene::{FaultKind, NoiseOf};

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
const PERCENT: Bounds = Bounds::within(0.0, 100.0, "%");
/// Reading units: 1 is the reading for 1 N straight above.
const READING: Bounds = Bounds::within(-1000.0, 1000.0, "");

pub(super) const NOISE_OF: [(&str, NoiseOf); 2] = [("full-scale", NoiseOf::FullScale), ("reading", NoiseOf::Reading)];

/// How a unit's fault is named, before it is known how much of it there is.
#[derive(Clone, Copy)]
pub(super) enum Taxel {
    Dead,
    Stuck,
    Clipped,
    Drifted,
}

pub(super) const TAXEL_FAULTS: [(&str, Taxel); 4] =
    [("dead", Taxel::Dead), ("stuck", Taxel::Stuck), ("clipped", Taxel::Clipped), ("drifted", Taxel::Drifted)];

keys! {
    /// `[scene]`
    scene {
        elastomer: Table(&elastomer::KEYS), Allowed, "the elastomer over the taxels; without it they read nothing";
        indenter: Table(&indenter::KEYS), Allowed, "the indenter's end; without it a point";
        taxels: Table(&taxels::KEYS), Allowed, "how the taxels differ from points that are all alike";
        taxel_noise: Table(&taxel_noise::KEYS), Allowed, "what each contact adds to a unit's output";
        hysteresis: Table(&hysteresis::KEYS), Allowed, "what a unit reads more as the load goes than as it comes";
        taxel_fault: Tables(&taxel_fault::KEYS), Allowed, "units that are broken";
        converter: Table(&converter::KEYS), Allowed, "the converter's steps and its range";
        contact: Table(&contact::KEYS), Refused, "the relaxed force against the depth";
        relaxation: Tables(&relaxation::KEYS), Allowed, "what a sudden load adds, and how it decays";
        mounting: Table(&mounting::KEYS), Allowed, "how the specimen really lies, seen from where the rig says";
        surface: Table(&surface::KEYS), Allowed, "the surface's shape; without it flat and level";
        stiffness: Table(&stiffness::KEYS), Allowed, "how the stiffness differs from place to place";
        stage: Table(&stage::KEYS), Allowed, "what the stage makes of its controller's motions";
        load_cell: Table(&load_cell::KEYS), Allowed, "the load cell's imperfections";
        latency_ms: Table(&latency_ms::KEYS), Allowed, "the least and the most time from a request to its answer";
        fault: Tables(&fault::KEYS), Allowed, "what goes wrong, and when";
    }
}

keys! {
    /// `elastomer` of the scene.
    elastomer {
        depth_mm: Number(above(0.0, 1000.0, "mm")), Refused, "how deep the taxels lie", "5.0";
        bonded_poisson_ratio: Number(within(0.0, MOST_POISSON_RATIO, "")), Allowed,
            "a layer bonded to what carries the taxels, with this ratio; without it a half-space", "0.49";
    }
}

keys! {
    /// `indenter` of the scene.
    indenter {
        radius_mm: Number(RADIUS), or(0.0), "the radius of its flat end", "0.5";
    }
}

keys! {
    /// `taxels` of the scene.
    taxels {
        radius_mm: Number(RADIUS), or(0.0), "the radius of the disc that a taxel averages over", "1.0";
        gain_spread_percent: Number(within(0.0, 90.0, "%")), or(0.0), "how far gains differ, either way", "20.0";
        place_spread_mm: Number(within(0.0, 10.0, "mm")), or(0.0), "how far places are off, sd along x and y", "0.1";
        depth_spread_percent: Number(within(0.0, 30.0, "%")), or(0.0), "how far depths differ, sd", "5.0";
        baseline: Number(READING), or(0.0), "what every unit reads without a load", "0.02";
    }
}

keys! {
    /// `taxel_noise` of the scene.
    taxel_noise {
        repeatability_percent: PerUnit(PERCENT), Refused, "sd of what a contact adds", "[1.6, 3.74, 2.19]";
        of: Word(&words(&NOISE_OF)), or_word("full-scale"), "what the percentages are of", "\"reading\"";
        floor: Number(within(0.0, 1000.0, "")), or(0.0), "sd of what is added whatever the load", "0.001";
    }
}

keys! {
    /// `hysteresis` of the scene.
    hysteresis {
        hysteresis_percent: PerUnit(PERCENT), Refused, "the widest gap between the two branches, of full scale",
            "[4.11, 2.29, 2.88]";
    }
}

keys! {
    /// `[[scene.taxel_fault]]`
    taxel_fault {
        unit: Whole(1, u16::MAX as u64), Refused, "which unit, counted from 1", "5";
        kind: Word(&words(&TAXEL_FAULTS)), Refused, "how it is broken", "\"dead\"";
    }
    by kind {
        stuck {
            reading: Number(READING), Refused, "what it reads for ever", "3.0";
        }
        clipped {
            reading: Number(READING), Refused, "what it never reads more than", "0.3";
        }
        drifted {
            gain_percent: Number(within(-100.0, 1000.0, "%")), Refused, "how much more it reads", "-10.0";
        }
    }
}

keys! {
    /// `converter` of the scene.
    converter {
        bits: Whole(1, 32), Refused, "how many bits it has", "16";
        range: Number(above(0.0, 1000.0, "")), Refused, "the largest reading that it can give, either way", "10.0";
    }
}

keys! {
    /// `contact` of the scene.
    contact {
        linear_n_mm: Number(STIFFNESS), Refused, "the force's linear part", "1.1";
        quadratic_n_mm2: Number(within(0.0, 100_000.0, "N/mm^2")), or(0.0), "its quadratic part", "0.1556";
        toe_mm: Number(within(0.0, 10.0, "mm")), or(0.0), "the depth over which the tip comes to bear fully", "0.01";
    }
}

keys! {
    /// One of `relaxation` of the scene.
    relaxation {
        share: Number(within(0.0, 10.0, "")), Refused, "the share of a sudden load that is added", "0.05";
        time_s: Number(TIME), Refused, "how long that takes to decay to 37 %", "0.3";
    }
}

keys! {
    /// `mounting` of the scene.
    mounting {
        x_mm: Number(PLACE), or(0.0), "where its origin is along x", "0.6";
        y_mm: Number(PLACE), or(0.0), "where its origin is along y", "-0.4";
        z_mm: Number(PLACE), or(0.0), "how much deeper its surface lies", "0.1";
        rotation_deg: Number(ROTATION), or(0.0), "how far it is turned, from x towards y", "3.0";
    }
}

keys! {
    /// `surface` of the scene.
    surface {
        tilt_mm: Number(HEIGHT), or(0.0), "how far its plane lies off anywhere in the loading area", "0.2";
        bumps_mm: Number(HEIGHT), Allowed, "what its bumps never exceed, either way; without it there are none", "0.005";
        bumps_wavelength_mm: Range(within(0.1, 1000.0, "mm")), or_range(6.0, 12.0),
            "the least and the most wavelength of the bumps", "[6.0, 12.0]";
        roughness_mm: Number(HEIGHT), Allowed, "sd of what each spot of 1 um has for itself; without it none", "0.001";
        wave_mm: Number(HEIGHT), or(0.0), "how far it rises and sinks, as a sine of the time", "0.005";
        wave_s: Number(TIME), or(60.0), "how long one turn of that takes", "60.0";
    }
}

keys! {
    /// `stiffness` of the scene.
    stiffness {
        smooth_percent: Number(STIFFER), or(0.0), "what its smooth part never exceeds, either way", "6.0";
        white_percent: Number(STIFFER), or(0.0), "sd of what each spot of 1 um has for itself", "0.5";
    }
}

keys! {
    /// `stage` of the scene.
    stage {
        servo_ms: Number(LAG), or(0.0), "how much later than its controller's profile it is anywhere", "7.0";
        quantum_mm: Number(within(0.0, 1.0, "mm")), or(0.0), "what targets are rounded to a multiple of", "0.0001";
        backlash_mm: Number(within(0.0, 1.0, "mm")), or(0.0), "the play of z that its read-back doesn't show", "0.003";
    }
}

keys! {
    /// `load_cell` of the scene.
    load_cell {
        noise_n: Number(FORCE), or(0.0), "sd of one conversion", "0.003";
        noise_ahead_n: Number(FORCE), or(0.0), "sd of the noise that came through its low-pass", "0.002";
        offset_n: Number(OFFSET), or(0.0), "what it reads with nothing on it", "0.0";
        drift_n_min: Number(within(-10.0, 10.0, "N/min")), or(0.0), "how fast its zero drifts", "0.03";
        wander_n: Number(FORCE), or(0.0), "how far its zero wanders either way, as a sine", "0.005";
        wander_s: Number(TIME), or(25.0), "how long one turn of that takes", "25.0";
        hum_n: Number(FORCE), or(0.0), "amplitude of the mains hum in what it reads", "0.01";
        hum_hz: Number(within(1.0, 1000.0, "Hz")), or(50.0), "the frequency of that", "49.8";
        gain_error_percent: Number(within(-300.0, 300.0, "%")), or(0.0), "how much more of a force it reads", "1.0";
        transport_ms: Number(LAG), or(0.0), "from a conversion to when it can be read", "2.0";
        low_pass_hz: Number(within(0.1, 1e6, "Hz")), Allowed, "the corner of its low-pass; without it there is none",
            "100.0";
        stiffness_n_mm: Number(STIFFNESS), Allowed, "how stiff it and the indenter are; without it rigid", "10.0";
        tool_kg: Number(within(0.0, 100.0, "kg")), or(0.0), "what hangs from it and moves with the stage", "0.2";
    }
}

keys! {
    /// `latency_ms` of the scene. The defaults: an ESP301 answers in 5 to 20 ms; a transmitter at 115200 baud needs 1.5 ms for
    /// the bytes of an exchange and two silences of 1.75 ms less what the driver waits itself; a T7 answers in 1 to 2 ms.
    latency_ms {
        stage: Range(LATENCY), or_range(5.0, 20.0), "the stage's controller", "[5.0, 20.0]";
        load_cell: Range(LATENCY), or_range(2.0, 3.0), "the load cell's transmitter", "[2.0, 3.0]";
        array: Range(LATENCY), or_range(1.0, 2.0), "the array's converter", "[1.0, 2.0]";
        spikes: Table(&spikes::KEYS), Allowed, "exchanges of the stage that take much longer than others";
    }
}

keys! {
    /// `spikes` of the latencies.
    spikes {
        share: Number(within(0.0, 1.0, "")), Refused, "their share of all exchanges", "0.02";
        ms: Number(LATENCY), Refused, "how much longer they take", "200.0";
    }
}

keys! {
    /// `[[scene.fault]]`
    fault {
        kind: Word(&words(&FaultKind::ALL)), Refused, "what goes wrong", "\"stuck\"";
        from_s: Number(within(0.0, 1e9, "s")), Refused, "from when on, since the rig was opened", "12.0";
    }
    by kind {
        saturated {
            value: Number(FORCE), Allowed, "what the load cell never reads more than; without it 0.8 N", "0.8";
        }
        hard_contact = "hard-contact" {
            value: Number(STIFFNESS), Allowed, "the stiffness from the next contact on; without it 20 N/mm", "20.0";
        }
        slow_stage = "slow-stage" {
            value: Number(LATENCY), Allowed, "how much longer each exchange takes; without it 200 ms", "200.0";
        }
        noisy {
            value: Number(within(0.0, 1e6, "times")), Allowed, "how many times the noise; without it 10", "10.0";
        }
        drifted_zero = "drifted-zero" {
            value: Number(OFFSET), Allowed, "what the load cell reads more; without it -0.5 N", "-0.5";
        }
    }
}
