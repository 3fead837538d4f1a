use crate::quantity::Place;

/// One contact, as solved, and how sure that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Where, specimen frame, mm.
    pub place: Place,
    /// How hard, N. Noise can make the force of a very light contact negative; it is reported as it comes.
    pub force_n: f64,
    /// How far off place and force are likely to be; none where the calibration can't tell.
    pub covariance: Option<Covariance>,
    /// How badly the reading fits one contact there: 0 is a perfect fit, 1 the threshold that a single contact passes
    /// as rarely as the false-alarm rate says. None where the calibration can't tell.
    pub misfit: Option<f64>,
    /// Whether to believe it.
    pub verdict: Verdict,
}

/// The covariance of x (mm), y (mm) and force (N), in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [[f64; 3]; 3]);

impl Covariance {
    /// One-sigma error of x, mm.
    pub fn x_mm(&self) -> f64 {
        self.0[0][0].sqrt()
    }

    /// One-sigma error of y, mm.
    pub fn y_mm(&self) -> f64 {
        self.0[1][1].sqrt()
    }

    /// One-sigma error of the force, N.
    pub fn force_n(&self) -> f64 {
        self.0[2][2].sqrt()
    }
}

/// Whether a solution can be believed, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing speaks against it.
    Ok,
    /// The reading can't be told from that of no contact.
    WeakSignal,
    /// The contact lies outside the calibrated area.
    OutsideArea,
    /// No single contact reads like this.
    NotOneContact,
    /// One unit, counted from 0, contradicts all others.
    ChannelFault(usize),
}
