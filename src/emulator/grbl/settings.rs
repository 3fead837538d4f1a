//! Numbered settings, as delivered; no client changes them.

/// Answer to `$$`, in the order and the units of GRBL's manual: homing and soft limits on, hard limits off.
pub const LINES: &str = "\
$0=10 $1=255 $2=0 $3=0 $4=0 $5=0 $6=0 $10=1 $11=0.010 $12=0.002 $13=0 $20=1 $21=0 $22=1 $23=0 $24=60.000 $25=600.000 \
$26=25 $27=0.500 $30=1000 $31=0 $32=0 $100=800.000 $101=800.000 $102=800.000 $110=1500.000 $111=1500.000 $112=1500.000 \
$120=100.000 $121=100.000 $122=100.000 $130=25.000 $131=25.000 $132=25.000";

/// `$24`: speed of locating a switch, mm/s.
pub const LOCATE_MM_S: f64 = 1.0;
/// `$25`: speed of searching for a switch, mm/s.
pub const SEEK_MM_S: f64 = 10.0;
/// `$26`: rest between the phases of homing, s.
pub const DEBOUNCE_S: f64 = 0.025;
/// `$27`: distance that an axis moves back from its switch, mm.
pub const PULL_OFF_MM: f64 = 0.5;
/// `$100` to `$102`: steps per mm.
pub const STEPS_PER_MM: f64 = 800.0;
/// `$110` to `$112`: largest rate of an axis, mm/s.
pub const MOST_MM_S: f64 = 25.0;
/// `$120` to `$122`: acceleration of an axis, mm/s^2.
pub const ACCELERATION_MM_S2: f64 = 100.0;
/// `$130` to `$132`: travel, mm.
pub const TRAVEL_MM: f64 = 25.0;
