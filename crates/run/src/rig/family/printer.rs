//! What printers can't do, with any firmware.

use crate::rig::spec::{Home, Misfit, RigSpec};
use palpate_sim::scene::SceneDevice;

/// Returns the reasons why a printer can't work with the rest of the rig.
pub(super) fn misfits(rig: &RigSpec) -> Vec<Misfit> {
    let misfit = |text: &str, help| Misfit { role: SceneDevice::Stage, text: text.to_owned(), help: Some(help) };
    let mut misfits = Vec::new();
    if rig.stage.home != Home::ByHand {
        let help = "write `home = \"by hand\"`: a person brings the axes to the rig's zero";
        misfits.push(misfit("a printer can't be stopped while it searches for home", help));
    }
    misfits
}
