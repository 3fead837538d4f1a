//! Wear of the taxels by contacts.

/// Change of every taxel by each contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wear {
    /// Change of the gain, as a share of the gain without wear, 1 per contact. The gain falls to 0 at most.
    pub gain_per_press: f64,
    /// Change of the output, loaded or not, reading units per contact.
    pub zero_per_press: f64,
}

/// Wear, and the number of contacts so far, the present one included. A contact begins when the tip touches the specimen.
#[derive(Clone, Copy)]
pub(super) struct WearState {
    wear: Wear,
    contacts: u64,
}

impl WearState {
    pub(super) fn new(wear: Wear) -> Self {
        WearState { wear, contacts: 0 }
    }

    /// Counts a contact that begins.
    pub(super) fn touch(&mut self) {
        self.contacts += 1;
    }

    /// Factor on the taxels' gains, and shift of their zeros, reading units.
    pub(super) fn of_taxels(&self) -> (f64, f64) {
        let contacts = self.contacts as f64;
        ((1.0 + contacts * self.wear.gain_per_press).max(0.0), contacts * self.wear.zero_per_press)
    }
}
