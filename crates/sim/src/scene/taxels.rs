//! Readings of the taxels in a running scene: hysteresis, creep, and the effects of temperature and wear.

use super::creep::{CreepState, ForcePiece};
use super::skin::Skin;
use super::spec::{SceneSpec, Wear};
use super::temperature::Temperature;
use palpate_core::quantity::{Place, RandomStream, stream};

/// Force reversal over which a taxel changes from its loading branch to its unloading branch, N. The transition is smooth at both
/// ends. So the relaxation of a hold (some 2 % of the load) doesn't leave the branch.
const CROSSING_N: f64 = 0.5;

/// State of the taxels in a running scene: a skin with noise, hysteresis and the effects over time. The noise is one draw for each
/// unit and contact.
#[derive(Clone)]
pub(super) struct TaxelState {
    skin: Skin,
    /// Reading without load, before temperature and wear shift it.
    baseline: f64,
    rng: RandomStream,
    /// Reversal of the force from loading, 0 to 1.
    reversal: f64,
    creep: Option<CreepState>,
    temperature: Option<Temperature>,
    wear: Option<Wear>,
    /// Contacts since the rig was opened, and those that wear the place of the present contact.
    contacts: u64,
    contacts_here: u64,
    /// Contacts of each place, if wear is local.
    places: Vec<(Place, u64)>,
}

impl TaxelState {
    /// Creates the taxels of a scene, whose skin this is, without load.
    pub(super) fn new(skin: Skin, spec: &SceneSpec) -> Self {
        TaxelState {
            baseline: spec.skin.taxels.baseline,
            rng: stream(0, 0, "taxel noise"),
            reversal: 0.0,
            creep: CreepState::new(&spec.taxel_creep, spec.taxel_lag_s, skin.len()),
            temperature: spec.temperature,
            wear: spec.wear,
            contacts: 0,
            contacts_here: 0,
            places: Vec::new(),
            skin,
        }
    }

    pub(super) fn reseed(&mut self, rng: RandomStream) {
        self.rng = rng;
    }

    /// Begins a new contact at a place, which differs slightly from the last one.
    pub(super) fn touch(&mut self, place: Place) {
        self.skin.draw_contact(&mut self.rng);
        self.reversal = 0.0;
        self.contacts += 1;
        self.contacts_here = self.wear.map_or(0, |wear| self.contacts_near(place, wear.radius_mm));
    }

    /// Counts a contact at a place, and returns the number of contacts within a distance.
    fn contacts_near(&mut self, place: Place, radius_mm: f64) -> u64 {
        if radius_mm.is_infinite() {
            return self.contacts;
        }
        match self.places.iter_mut().find(|(known, _)| *known == place) {
            Some((_, count)) => *count += 1,
            None => self.places.push((place, 1)),
        }
        let near = |known: &Place| (known.x_mm - place.x_mm).hypot(known.y_mm - place.y_mm) <= radius_mm;
        self.places.iter().filter(|(known, _)| near(known)).map(|(_, count)| count).sum()
    }

    /// Takes a change of the force from one value to another.
    pub(super) fn follow(&mut self, from_n: f64, to_n: f64, touching: bool) {
        if touching {
            self.reversal = (self.reversal - (to_n - from_n) / CROSSING_N).clamp(0.0, 1.0);
        } else {
            self.skin.forget_contact();
            self.reversal = 0.0;
        }
    }

    /// Whether the outputs depend on earlier loads.
    pub(super) fn creeps(&self) -> bool {
        self.creep.is_some()
    }

    /// Takes the load over a stretch of time, as [`CreepState::follow`] does.
    pub(super) fn creep(&mut self, pieces: &[ForcePiece], load_at: impl Fn(f64, f64) -> ([f64; 3], Place)) {
        if let Some(creep) = &mut self.creep {
            creep.follow(&self.skin, pieces, load_at);
        }
    }

    /// Writes the readings of the taxels at `now_s` under a force along x, y and into the specimen at `place`, reading units (1 = 1 N
    /// straight above). Temperature and wear change the gain of the outputs that have crept.
    pub(super) fn outputs(&mut self, force_n: [f64; 3], place: Place, now_s: f64, outputs: &mut [f64]) {
        outputs.fill(0.0);
        self.skin.add_force(force_n, place, outputs);
        if let Some(creep) = &self.creep {
            creep.read_out(outputs);
        }
        let warm = self.temperature.map(|temperature| temperature.of_taxels(now_s));
        let worn = self.wear.map(|wear| wear.of_taxels(self.contacts_here, self.contacts));
        let mut shifted = self.baseline;
        for (gain, zero) in warm.into_iter().chain(worn) {
            outputs.iter_mut().for_each(|output| *output *= gain);
            shifted += zero;
        }
        self.skin.set_baseline(shifted);
        let unloading = self.reversal * self.reversal * (3.0 - 2.0 * self.reversal);
        self.skin.read_out(unloading, outputs);
    }
}

impl Wear {
    /// Factor on the taxels' gains by the contacts here, and shift of their zeros by all contacts, reading units.
    fn of_taxels(&self, here: u64, contacts: u64) -> (f64, f64) {
        ((1.0 + here as f64 * self.gain_per_press).max(0.0), contacts as f64 * self.zero_per_press)
    }
}
