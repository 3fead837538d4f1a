//! The firmware behind the protocol, from the answer to `$I`.

/// Firmware that accepts GRBL 1.1's lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrblFirmware {
    /// GRBL 1.1 itself.
    Grbl,
    /// grblHAL, which reports the GRBL version that it is compatible with.
    GrblHal,
    /// FluidNC, which reports its own version. It has its settings in a file.
    FluidNc,
}

/// A build of a firmware.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Build {
    /// The firmware.
    pub firmware: GrblFirmware,
    /// Version, as reported.
    pub version: String,
    /// Whether homing sets the count to zero (option `Z`, HOMING_FORCE_SET_ORIGIN).
    pub sets_origin: bool,
}

impl Build {
    /// Reads the answer to `$I`; `None` if it isn't from a firmware that jogs as GRBL 1.1 does.
    pub fn read(texts: &[String]) -> Option<Build> {
        let field = |name: &str| texts.iter().find_map(|text| text.strip_prefix(name)?.strip_suffix(']'));
        let version = field("[VER:")?.trim_end_matches([':', ' ']).to_owned();
        let firmware = match () {
            () if version.contains("FluidNC") => GrblFirmware::FluidNc,
            () if field("[FIRMWARE:").is_some_and(|name| name.eq_ignore_ascii_case("grblHAL")) => GrblFirmware::GrblHal,
            () if version.starts_with("1.1") => GrblFirmware::Grbl,
            () => return None,
        };
        let options = field("[OPT:").and_then(|options| options.split(',').next()).unwrap_or_default();
        let sets_origin = firmware != GrblFirmware::FluidNc && options.contains('Z');
        Some(Build { firmware, version, sets_origin })
    }
}

impl std::fmt::Display for Build {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = match self.firmware {
            GrblFirmware::Grbl => "GRBL ",
            GrblFirmware::GrblHal => "grblHAL ",
            GrblFirmware::FluidNc => "", // its version contains its name
        };
        write!(f, "{name}{}", self.version)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn firmware_is_recognised_by_its_greeting() {
        let read = |texts: &[&str]| Build::read(&texts.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>());
        let shown = |texts| read(texts).map(|build| (build.to_string(), build.sets_origin));
        assert_eq!(shown(&["[VER:1.1h.20190825:]", "[OPT:V,15,128]"]), Some(("GRBL 1.1h.20190825".to_owned(), false)));
        assert_eq!(shown(&["[VER:1.1f.20170801:]", "[OPT:VZ,15,128]"]), Some(("GRBL 1.1f.20170801".to_owned(), true)));
        assert_eq!(
            shown(&["[VER:1.1f.20230610:]", "[OPT:VNMSL,100,1024,3,0]", "[FIRMWARE:grblHAL]"]),
            Some(("grblHAL 1.1f.20230610".to_owned(), false))
        );
        let fluid = shown(&["[VER:3.7 FluidNC v3.7.16:]", "[OPT:MPHS]"]);
        assert_eq!(fluid, Some(("3.7 FluidNC v3.7.16".to_owned(), false)));
        assert_eq!(shown(&["[VER:0.9j.20160303:]"]), None);
        assert_eq!(shown(&["echo:Unknown command"]), None);
    }
}
