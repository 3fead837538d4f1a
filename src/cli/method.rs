//! A calibrated sensor for a person: its method, the reason for the choice, and what `--constant-load` would gain.

use super::summary::tell;
use super::tables::{chosen, filled, memories};
use crate::api::fit::constant_load_gain_mm;
use crate::api::{Failure, Sensor};
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_solver::{Model, Validity};

/// Prints the method of a sensor and its calibration; if it was fitted just now, also the reason for the choice.
pub(super) fn tell_sensor(Sensor { model, sensor, .. }: &Sensor, is_new: bool) -> Result<(), Failure> {
    let of = sensor.as_ref().filter(|_| !is_new).map_or(String::new(), |sensor| format!(" of sensor {sensor}"));
    tell(&format!("{}{of}\n", fitted_to(model.method(), model.validity())))?;
    match model {
        SensorModel::Contact(model) if is_new => model.fitted().choice().map_or(Ok(()), |choice| tell(&chosen(choice))),
        SensorModel::History(model) => model.choice().map_or(Ok(()), |choice| tell(&filled(&memories(choice), "  "))),
        _ => Ok(()),
    }
}

/// Describes which method was fitted to how much. A series of readings has no places.
pub(super) fn fitted_to(method: &str, validity: &Validity) -> String {
    let rows = if validity.places == 0 { "readings" } else { "presses" };
    format!("{method}, fitted to {} {rows} of {} outputs", validity.presses, validity.units)
}

/// For a calibration without forces, prints what `--constant-load` would gain, by the same method on held-out presses.
pub(super) fn tell_constant_load(model: &Model) -> Result<(), Failure> {
    let Some((any_mm, constant_mm)) = constant_load_gain_mm(model) else { return Ok(()) };
    tell(&filled(
        &format!(
            "note: if every contact presses as hard as the calibration, --constant-load lowers the error on held-out presses from \
             {any_mm:.3} to {constant_mm:.3} mm; with other forces it is larger"
        ),
        "  ",
    ))
}
