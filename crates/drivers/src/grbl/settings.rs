//! The controller's settings, checked against the rig. They are stored in an EEPROM and aren't written.

use super::firmware::{Build, GrblFirmware};
use palpate_core::quantity::{Axis, Range};
use palpate_link::device::StageUse;
use std::collections::BTreeMap;

/// Coarsest step with which presses are possible, mm. The read-back must be within 3 um of the target.
const STEP_MOST_MM: f64 = 0.005;

/// Idle delay that leaves the motors on (settings document, `$1`).
const ALWAYS_ON: f64 = 255.0;

/// Tolerance of a comparison of distances that a board rounds to three decimals, mm.
pub(super) const ROUNDING_MM: f64 = 0.001;

/// Numbers of the settings (settings document).
const IDLE_DELAY_MS: u32 = 1;
const REPORT_INCHES: u32 = 13;
const SOFT_LIMITS: u32 = 20;
const HOMING: u32 = 22;
const HOMING_DIRECTION: u32 = 23;
const HOMING_SEEK_MM_MIN: u32 = 25;
const PULL_OFF_MM: u32 = 27;
// the first of three, for x
const STEPS_PER_MM: u32 = 100;
const MAX_RATE_MM_MIN: u32 = 110;
const ACCELERATION_MM_S2: u32 = 120;
const TRAVEL_MM: u32 = 130;

/// FluidNC's names of two settings for which it reports no number (its wiki, "Config file").
pub(super) const FLUIDNC_IDLE: &str = "$/stepping/idle_ms";
pub(super) const FLUIDNC_INCHES: &str = "$/report_inches";

/// The answers to `$$`, and to FluidNC's two questions.
#[derive(Debug, Default)]
pub struct ReportedSettings {
    values: BTreeMap<u32, f64>,
}

/// Result of the check.
#[derive(Debug)]
pub struct Checked {
    /// Facts that a person should know.
    pub warnings: Vec<String>,
    /// What each axis counts after homing, mm; `None` if the controller doesn't report it.
    pub home_mm: Option<[f64; 3]>,
}

/// What an axis counts between its home and its far end.
#[derive(Clone, Copy, Debug)]
pub struct AxisCounts {
    /// The axis.
    pub axis: Axis,
    /// Counts that are possible, mm.
    pub range: Range,
    /// Count after homing, mm.
    pub home_mm: f64,
    length_mm: f64,
    off_mm: f64,
}

impl AxisCounts {
    /// Returns the reason why the axis can't have the travel of the rig; `None` if it can.
    pub fn misfit(&self, usage: &StageUse) -> Option<String> {
        let AxisCounts { axis, range, home_mm, length_mm, off_mm } = *self;
        let (name, key) = (axis.name(), TRAVEL_MM + axis.index() as u32);
        let (travel, allowed) = (usage.travel.along(axis), range.widened(ROUNDING_MM));
        if !allowed.contains(travel.min) || !allowed.contains(travel.max) {
            return Some(format!(
                "{name} counts from {:.3} to {:.3} mm (${key}={length_mm:.3}, home at {home_mm:.3}), but \
                 `travel_mm.{name}` goes from {} to {} mm: change it, and the `frame` with it",
                range.min, range.max, travel.min, travel.max
            ));
        }
        (!usage.reach(axis).contains(home_mm)).then(|| {
            format!(
                "{name} is at {home_mm:.3} mm after homing (${PULL_OFF_MM}={off_mm:.3}), but `travel_mm.{name}` goes from \
                 {} to {} mm: widen it to that place",
                travel.min, travel.max
            )
        })
    }
}

impl ReportedSettings {
    /// Takes the numbered settings, and FluidNC's named ones from other text that it sent.
    pub fn new(mut values: BTreeMap<u32, f64>, texts: &[String]) -> ReportedSettings {
        let named = |name: &str| texts.iter().find_map(|text| text.strip_prefix(name)?.strip_prefix('='));
        if let Some(ms) = named(FLUIDNC_IDLE).and_then(|ms| ms.trim().parse().ok()) {
            values.insert(IDLE_DELAY_MS, ms);
        }
        if let Some(inches) = named(FLUIDNC_INCHES) {
            values.insert(REPORT_INCHES, f64::from(u8::from(inches.trim() != "false")));
        }
        ReportedSettings { values }
    }

    /// Compares them with the rig.
    ///
    /// # Errors
    /// Each setting that is unsafe or contradicts the rig, with the line to send, in an order in which the controller takes these lines.
    pub fn check(&self, build: &Build, usage: &StageUse) -> Result<Checked, Vec<String>> {
        let mut checks = vec![self.check_unit(), self.check_idle_delay()];
        let (mut warnings, mut home_mm) = (Vec::new(), None);
        if usage.by_hand {
            checks.push(self.check_by_hand());
            warnings.push(
                "it has no switches: its position is the one that a person confirmed, and only this program's limits \
                 stop it"
                    .to_owned(),
            );
            home_mm = Some([0.0; 3]);
        } else {
            // a controller without a search for home refuses soft limits (GRBL, error 10)
            checks.extend([self.check_homing(), self.check_soft_limits(), self.check_direction(usage)]);
            warnings.extend(self.fast_search(usage));
            // FluidNC's configuration states what it counts at home (mpos_mm), and `$$` doesn't
            if build.firmware != GrblFirmware::FluidNc {
                let counts = Axis::ALL.map(|axis| self.counts(build, axis));
                if let [Ok(x), Ok(y), Ok(z)] = &counts {
                    home_mm = Some([x.home_mm, y.home_mm, z.home_mm]);
                }
                // the rig's travel is within what each axis counts
                checks.extend(counts.map(|counts| counts?.misfit(usage).map_or(Ok(()), Err)));
            }
        }
        for axis in Axis::ALL {
            checks.extend([self.check_rate(axis, usage), self.check_acceleration(axis, usage)]);
            match self.coarse_step(axis) {
                Ok(warning) => warnings.extend(warning),
                Err(text) => checks.push(Err(text)),
            }
        }
        let mut texts: Vec<String> = checks.into_iter().filter_map(Result::err).collect();
        texts.dedup(); // one setting decides about all axes
        if texts.is_empty() { Ok(Checked { warnings, home_mm }) } else { Err(texts) }
    }

    fn check_unit(&self) -> Result<(), String> {
        match self.required(REPORT_INCHES, "unit of its reports")? {
            0.0 => Ok(()),
            _ => Err(format!("it reports inches; send ${REPORT_INCHES}=0")),
        }
    }

    fn check_idle_delay(&self) -> Result<(), String> {
        let idle_ms = self.required(IDLE_DELAY_MS, "idle delay of its motors")?;
        if idle_ms >= ALWAYS_ON {
            return Ok(());
        }
        Err(format!(
            "its motors are off {idle_ms:.0} ms after each motion, and the axes can slip; send ${IDLE_DELAY_MS}=255 \
             (FluidNC: {FLUIDNC_IDLE}=255)"
        ))
    }

    fn check_by_hand(&self) -> Result<(), String> {
        match self.required(HOMING, "homing cycle")? {
            0.0 => Ok(()),
            _ => Err(format!("it homes to switches (${HOMING}=1), but the rig has `home = \"by hand\"`: remove it")),
        }
    }

    fn check_homing(&self) -> Result<(), String> {
        // grblHAL: bit 0 of several
        if self.required(HOMING, "homing cycle")? as u64 & 1 == 1 {
            return Ok(());
        }
        Err(format!(
            "homing is disabled, so its position is unknown; send ${HOMING}=1, or write `home = \"by hand\"` in \
             [stage] if it has no switches"
        ))
    }

    fn check_soft_limits(&self) -> Result<(), String> {
        match self.required(SOFT_LIMITS, "soft limits")? {
            0.0 => Err(format!("its soft limits are off; send ${SOFT_LIMITS}=1")),
            _ => Ok(()),
        }
    }

    /// Checks that z homes away from the specimen.
    fn check_direction(&self, usage: &StageUse) -> Result<(), String> {
        let mask = self.required(HOMING_DIRECTION, "homing direction")?;
        if is_set(mask, Axis::Z) == (usage.away < 0.0) {
            return Ok(());
        }
        let right = mask as u64 ^ (1 << Axis::Z.index());
        Err(format!(
            "its z homes toward the specimen (${HOMING_DIRECTION}={mask:.0}); send ${HOMING_DIRECTION}={right} if its \
             switch is at the other end, or correct `frame.down`"
        ))
    }

    /// Returns what a person should know of a search for home that is faster than the rig's.
    fn fast_search(&self, usage: &StageUse) -> Option<String> {
        let seek_mm_s = self.of(HOMING_SEEK_MM_MIN).map(|rate| rate / 60.0).filter(|&v| v > usage.home_speed_mm_s)?;
        Some(format!(
            "it homes at {seek_mm_s:.2} mm/s. Up to {:.2} mm/s it stops within the force limit: \
             ${HOMING_SEEK_MM_MIN}={:.0}",
            usage.home_speed_mm_s,
            usage.home_speed_mm_s * 60.0
        ))
    }

    /// Returns what an axis that homes to its switch counts.
    ///
    /// GRBL counts from minus the travel to 0, and leaves its switches by the pull-off (limits.c). A build that sets the origin
    /// counts from 0 at home.
    ///
    /// # Errors
    /// A setting that isn't reported.
    pub fn counts(&self, build: &Build, axis: Axis) -> Result<AxisCounts, String> {
        let off_mm = self.required(PULL_OFF_MM, "homing pull-off")?;
        let mask = self.required(HOMING_DIRECTION, "homing direction")?;
        let length_mm = self.required(TRAVEL_MM + axis.index() as u32, "travel")?;
        let (home_mm, range) = match (is_set(mask, axis), build.sets_origin) {
            (false, false) => (-off_mm, Range { min: -length_mm, max: -off_mm }),
            (true, false) => (off_mm - length_mm, Range { min: off_mm - length_mm, max: 0.0 }),
            (false, true) => (0.0, Range { min: -length_mm, max: 0.0 }),
            (true, true) => (0.0, Range { min: 0.0, max: length_mm }),
        };
        Ok(AxisCounts { axis, range, home_mm, length_mm, off_mm })
    }

    fn check_rate(&self, axis: Axis, usage: &StageUse) -> Result<(), String> {
        let (key, name) = (MAX_RATE_MM_MIN + axis.index() as u32, axis.name());
        let rate_mm_s = self.required(key, "largest rate")? / 60.0;
        if rate_mm_s >= usage.speed_mm_s {
            return Ok(());
        }
        let least = usage.speed_mm_s * 60.0;
        Err(format!("{name} reaches at most {rate_mm_s:.2} mm/s; send ${key}={least:.0}, or lower the rig's"))
    }

    /// Checks that it brakes as hard as the rig states: otherwise a stop comes too late.
    fn check_acceleration(&self, axis: Axis, usage: &StageUse) -> Result<(), String> {
        let (key, name, wanted) = (ACCELERATION_MM_S2 + axis.index() as u32, axis.name(), usage.acceleration_mm_s2);
        let a_mm_s2 = self.required(key, "acceleration")?;
        if a_mm_s2 >= wanted {
            return Ok(());
        }
        Err(format!("{name} accelerates with {a_mm_s2} mm/s^2; send ${key}={wanted}, or lower the rig's"))
    }

    /// Returns what a person should know of an axis with coarse steps.
    fn coarse_step(&self, axis: Axis) -> Result<Option<String>, String> {
        let step_mm = 1.0 / self.required(STEPS_PER_MM + axis.index() as u32, "resolution")?;
        let is_coarse = step_mm > STEP_MOST_MM;
        let name = axis.name();
        Ok(is_coarse.then(|| format!("{name} moves in steps of {step_mm:.4} mm: too coarse for force control")))
    }

    fn of(&self, number: u32) -> Option<f64> {
        self.values.get(&number).copied()
    }

    fn required(&self, number: u32, what: &str) -> Result<f64, String> {
        self.of(number).ok_or_else(|| format!("it doesn't report the {what} (${number}), so nothing is known of it"))
    }
}

/// Whether an axis has its bit in a mask.
fn is_set(mask: f64, axis: Axis) -> bool {
    mask as u64 & (1 << axis.index()) != 0
}
