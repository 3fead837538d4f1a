//! The magnetometer MLX90393 as the library of ReSkin and AnySkin reads it (raunaqbhirangi/arduino-MLX90393, MLX90393.cpp and .h).

use crate::scene::Scene;

/// Time of `setup()` of the sketches, s: 10 ms, then some 5 ms for each of five chips (two waits of 2 ms in `MLX90393::begin`, and its
/// registers).
pub(super) const SETUP_S: f64 = 0.035;

/// Number of magnetic channels of a chip.
const AXES: usize = 3;

/// Magnetic field for one reading unit of a taxel, microtesla. 1 N directly above a taxel gives one reading unit.
pub(crate) const MICROTESLA_PER_UNIT: f64 = 100.0;

/// Magnetic field of each channel at rest, microtesla: that of the skin's magnets.
pub const REST_MICROTESLA: f64 = 500.0;

/// Sensitivities at `setHallConf(0x0C)`, microtesla for each step: `base_xy_sens_hc0xc` and `base_z_sens_hc0xc`.
const XY_STEP: f32 = 0.150;
const Z_STEP: f32 = 0.242;
/// `gain_multipliers[6]`, set by `begin()`: the float nearest to the library's 1.33333333.
const GAIN: f32 = 1.333_333_4;

/// Raw temperature: 27.3 °C by `convertRaw`.
const RAW_TEMPERATURE: u16 = 46_350;

/// Reading of one chip in the order of `struct txyz`: temperature, °C, then x, y and z, microtesla.
pub(super) struct Txyz(pub [f32; 1 + AXES]);

/// Reads all chips. The channels x, y and z of the first chip are the first three outputs of the scene, and so on. Channels
/// without an output stay at rest.
pub(super) fn read(scene: &mut Scene, now_s: f64, microtesla_per_unit: f64) -> Vec<Txyz> {
    let mut outputs = vec![0.0; scene.taxels()];
    scene.outputs(now_s, &mut outputs);
    let chip = |outputs: &[f64]| {
        let field = |axis: usize, step: f32| {
            let output = outputs.get(axis).copied().unwrap_or(0.0);
            converted(REST_MICROTESLA + output * microtesla_per_unit, step)
        };
        Txyz([temperature(), field(0, XY_STEP), field(1, XY_STEP), field(2, Z_STEP)])
    };
    outputs.chunks(AXES).map(chip).collect()
}

/// A field after the chip's converter (16 bits, resolution 0) and `convertRaw`, microtesla.
fn converted(microtesla: f64, step: f32) -> f32 {
    let raw = (microtesla / f64::from(step * GAIN)).round() as i16;
    f32::from(raw) * step * GAIN
}

fn temperature() -> f32 {
    25.0 + (f32::from(RAW_TEMPERATURE) - 46_244.0) / 45.2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_a_number_of_steps_and_ends_with_the_converter() {
        assert_eq!(converted(500.0, XY_STEP), 500.0);
        assert!((converted(500.09, XY_STEP) - 500.0).abs() < 1e-4);
        assert!((converted(500.0, Z_STEP) - 500.133_33).abs() < 1e-3); // 1550 steps of 0.322666 uT
        assert!((converted(1e9, XY_STEP) - 6553.4).abs() < 1e-2);
        assert!((converted(-1e9, Z_STEP) + 10_573.14).abs() < 1e-1);
        assert!((temperature() - 27.345).abs() < 1e-3);
    }
}
