//! The faults of the world: their kinds, the text that asks for them, and when they begin.
//!
//! A text is `kind:key=value,key=value`; `+` joins several. Every kind has one parameter with a default, and these triggers:
//! `at-press=N` (from the N-th place on), `at-force=N`, `at-height=MM` (the tip is at most so far over the surface), `at-s=S`.
//! All that are given must hold. `for-s=S` ends the fault again.

/// A kind of fault: its name, its parameter with a default, values for a campaign, and what it does.
#[derive(Debug)]
pub(crate) struct WorldKind {
    pub(crate) name: &'static str,
    pub(crate) parameter: &'static str,
    pub(crate) default: f64,
    pub(crate) tried: &'static [f64],
    pub(crate) meaning: &'static str,
}

const fn kind(
    name: &'static str,
    parameter: &'static str,
    default: f64,
    tried: &'static [f64],
    meaning: &'static str,
) -> WorldKind {
    WorldKind { name, parameter, default, tried, meaning }
}

/// Every kind. The word before the first hyphen is its class.
pub(crate) const KINDS: [WorldKind; 95] = [
    kind("stage-lost", "count", 1.0, &[1.0, 3.0], "answers are lost"),
    kind("stage-late", "s", 0.3, &[0.1, 0.3, 1.0, 2.5], "every answer is late"),
    kind("stage-twice", "n", 1.0, &[], "every answer comes twice"),
    kind("stage-garbage", "n", 1.0, &[], "answers aren't JSON"),
    kind("stage-wrong-id", "n", 1.0, &[], "answers have another number"),
    kind("stage-error", "n", 1.0, &[], "answers are errors"),
    kind("stage-silent", "n", 1.0, &[], "nothing is answered, motions are made"),
    kind("stage-dead", "n", 1.0, &[], "the program ends, a motion is finished"),
    kind("stage-nan", "n", 1.0, &[], "reports null as position"),
    kind("stage-inch", "n", 1.0, &[], "reports inches"),
    kind("stage-um", "n", 1.0, &[], "reports micrometres"),
    kind("stage-sign", "n", 1.0, &[], "reports positions with the wrong sign"),
    kind("stage-frozen", "n", 1.0, &[], "reports the same position again and again"),
    kind("stage-slow", "share", 0.3, &[0.1, 0.3, 0.7], "is slower than commanded"),
    kind("stage-fast", "times", 2.0, &[1.5, 2.0, 4.0], "is faster than commanded"),
    kind("stage-soft-brakes", "times", 20.0, &[3.0, 20.0], "`stop` brakes so many times more softly"),
    kind("stage-deeper", "mm", 0.2, &[0.1, 0.2, 0.4], "goes deeper than the target that it reports"),
    kind("stage-says-target", "n", 1.0, &[], "stands still and reports the target"),
    kind("stage-stands", "n", 1.0, &[], "stands still and reports that"),
    kind("stage-overshoots", "mm", 0.2, &[0.1, 0.2, 0.4], "passes the target and returns"),
    kind("stage-offset", "mm", 0.3, &[0.1, 0.3, 0.5], "its position is off, the tip is deeper"),
    kind("stage-early-target", "n", 1.0, &[], "reports the target and the end at once"),
    kind("stage-early-end", "n", 1.0, &[], "reports the end while it moves"),
    kind("stage-never-ends", "n", 1.0, &[], "reports motion for ever"),
    kind("stage-twice-way", "n", 1.0, &[], "goes twice the way down and reports the target"),
    kind("stage-short-way", "share", 0.6, &[0.5, 0.8], "goes a share of the way down and reports the target"),
    kind("stage-drops", "mm", 0.5, &[0.2, 0.5], "drops on its own and reports it"),
    kind("stage-drops-hidden", "mm", 0.5, &[0.2, 0.5], "drops on its own and doesn't report it"),
    kind("stage-creeps", "mm_s", 0.2, &[0.05, 0.2, 1.0], "creeps down by up to 0.5 mm and reports it"),
    kind("stage-mirror", "n", 1.0, &[], "z moves the other way and reports the target"),
    kind("stage-no-stop", "n", 1.0, &[], "`stop` is ignored"),
    kind("stage-late-stop", "s", 0.2, &[0.05, 0.2, 0.5], "`stop` acts late"),
    kind("stage-no-speed", "n", 1.0, &[], "`speed` is ignored"),
    kind("stage-late-move", "s", 0.2, &[0.1, 0.3], "a motion begins late"),
    kind("cell-lost", "count", 1.0, &[1.0, 3.0], "readings are lost"),
    kind("cell-late", "s", 0.2, &[0.05, 0.15, 0.3], "every reading is late"),
    kind("cell-twice", "n", 1.0, &[], "every reading comes twice"),
    kind("cell-garbage", "n", 1.0, &[], "readings aren't JSON"),
    kind("cell-wrong-id", "n", 1.0, &[], "readings have another number"),
    kind("cell-error", "n", 1.0, &[], "readings are errors"),
    kind("cell-silent", "n", 1.0, &[], "no reading any more"),
    kind("cell-dead", "n", 1.0, &[], "the program ends"),
    kind("cell-nan", "n", 1.0, &[], "reads NaN"),
    kind("cell-inf", "n", 1.0, &[], "reads 1e999"),
    kind("cell-null", "n", 1.0, &[], "reads null"),
    kind("cell-text", "n", 1.0, &[], "reads a text"),
    kind("cell-sign", "n", 1.0, &[], "reads with the wrong sign"),
    kind("cell-zero", "n", 1.0, &[], "reads exactly 0"),
    kind("cell-flag", "n", 1.0, &[], "reports that it is saturated"),
    kind("cell-broken", "n", 1.0, &[], "reports that it is broken"),
    kind("cell-clips", "n", 0.8, &[0.3, 0.8, 1.5], "reads at most so much, unflagged"),
    kind("cell-stuck", "n", 1.0, &[], "reads exactly the same again and again"),
    kind("cell-stuck-noise", "n", 1.0, &[], "its value sticks while the noise continues"),
    kind("cell-noisy", "times", 10.0, &[3.0, 10.0, 50.0], "has more noise"),
    kind("cell-grams", "times", 102.0, &[102.0], "reads grams for newtons"),
    kind("cell-spikes", "n", 1.0, &[-1.0, 0.5, 1.0], "one reading of 30 is off by so much"),
    kind("cell-hum", "n", 0.05, &[0.02, 0.1], "hums at 50 Hz"),
    kind("cell-offset", "n", -0.3, &[-0.5, -0.3, -0.1, 0.3], "its zero jumps"),
    kind("cell-drift", "n_s", -0.1, &[-0.3, -0.1, -0.05, -0.01, 0.1], "its zero drifts"),
    kind("cell-gain", "share", 0.6, &[0.1, 0.5, 0.52, 0.56, 0.6, 0.7, 0.76, 0.8, 1.25, 2.0], "its gain jumps"),
    kind("cell-ramp-gain", "per_s", -0.05, &[-0.2, -0.05, -0.02, 0.05], "its gain changes, down to 0.3"),
    kind("cell-slow", "lag", 0.8, &[0.2, 0.5, 0.8, 1.2, 1.5], "its filter is slow, s"),
    kind("cell-delayed", "s", 0.5, &[0.1, 0.2, 0.5, 1.0], "reads the force of so long ago"),
    kind("cell-replay", "s", 2.0, &[1.0, 2.0, 4.0], "repeats its last seconds"),
    kind("cell-slow-rate", "s", 0.1, &[0.05, 0.1, 0.2], "a new conversion is rare"),
    kind("cell-coarse", "n", 0.1, &[0.05, 0.2], "reads multiples of so much"),
    kind("cell-dead-band", "n", 0.3, &[0.1, 0.3, 0.6], "forces up to so much read as none"),
    kind("array-lost", "count", 1.0, &[1.0], "an answer is lost"),
    kind("array-late", "s", 0.3, &[0.1, 0.5, 1.5], "every answer is late"),
    kind("array-garbage", "n", 1.0, &[], "answers aren't JSON"),
    kind("array-silent", "n", 1.0, &[], "nothing is answered"),
    kind("array-dead", "n", 1.0, &[], "the program ends"),
    kind("array-nan", "n", 1.0, &[], "an output is NaN"),
    kind("array-short", "n", 1.0, &[], "an output is missing"),
    kind("array-stuck", "n", 1.0, &[], "all outputs stick"),
    kind("array-zero", "n", 1.0, &[], "all outputs are 0"),
    kind("array-shifted", "mm", 3.0, &[1.5, 3.0], "it has moved sideways"),
    kind("array-scaled", "times", 1000.0, &[0.5, 2.0, 1000.0], "its outputs are multiplied"),
    kind("array-taxel-dead", "n", 0.0, &[0.0, 1.0], "one output is 0"),
    kind("array-taxel-stuck", "n", 0.0, &[0.0, 2.0], "one output sticks"),
    kind("array-swapped", "n", 1.0, &[], "two outputs are swapped"),
    kind("array-noisy", "times", 30.0, &[30.0], "has more noise"),
    kind("specimen-jumps", "mm", 0.3, &[0.1, 0.3, 0.5], "rises at once"),
    kind("specimen-rises", "mm", 1.0, &[0.5, 1.0, 1.5, 2.0], "rises within 1 s"),
    kind("specimen-sinks", "mm", 1.0, &[0.3, 1.0], "sinks within 0.2 s"),
    kind("specimen-stiffer", "times", 3.0, &[1.5, 3.0, 20.0], "gets stiffer"),
    kind("specimen-softer", "times", 0.5, &[0.2, 0.5], "gets softer"),
    kind("specimen-moves", "mm", 3.0, &[1.0, 3.0], "moves sideways"),
    kind("specimen-tears", "n", 1.0, &[], "bears nothing any more"),
    kind("host-kill", "n", 1.0, &[], "palpate gets SIGKILL"),
    kind("host-stop", "s", 1.0, &[0.3, 1.0, 3.0], "palpate gets SIGSTOP, and SIGCONT later"),
    kind("host-term", "n", 1.0, &[], "palpate gets SIGTERM"),
    kind("host-int", "n", 1.0, &[], "palpate gets SIGINT"),
    kind("host-int-twice", "n", 1.0, &[], "palpate gets SIGINT twice"),
    kind("none", "n", 1.0, &[], "nothing: a clean run"),
];

/// A fault of a run.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    pub(crate) name: &'static str,
    pub(crate) value: f64,
    at_press: u32,
    at_force_n: Option<f64>,
    at_height_mm: Option<f64>,
    at_s: f64,
    for_s: f64,
    /// When it began, s, in the world's time.
    pub(crate) fired_s: Option<f64>,
    pub(crate) fired_press: u32,
}

/// What a trigger looks at.
pub(crate) struct WorldMoment {
    pub(crate) now_s: f64,
    pub(crate) press: u32,
    pub(crate) force_n: f64,
    pub(crate) height_mm: f64,
}

impl Fault {
    /// The faults that a text asks for.
    pub(crate) fn parse_all(text: &str) -> Result<Vec<Fault>, String> {
        text.split('+').map(Fault::parse).collect()
    }

    fn parse(text: &str) -> Result<Fault, String> {
        let (name, rest) = text.trim().split_once(':').unwrap_or((text.trim(), ""));
        let kind = KINDS.iter().find(|kind| kind.name == name).ok_or(format!("no fault is called {name:?}"))?;
        let (at_s, for_s) = (0.0, f64::INFINITY);
        let (at_force_n, at_height_mm, fired_s) = (None, None, None);
        let mut fault = Fault {
            name: kind.name,
            value: kind.default,
            at_press: 1,
            at_force_n,
            at_height_mm,
            at_s,
            for_s,
            fired_s,
            fired_press: 0,
        };
        for pair in rest.split(',').filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once('=').ok_or(format!("{pair:?} isn't key=value"))?;
            let value: f64 = value.parse().map_err(|_| format!("{pair:?} has no number"))?;
            match key {
                "at-press" => fault.at_press = value as u32,
                "at-force" => fault.at_force_n = Some(value),
                "at-height" => fault.at_height_mm = Some(value),
                "at-s" => fault.at_s = value,
                "for-s" => fault.for_s = value,
                key if key == kind.parameter => fault.value = value,
                _ => return Err(format!("{name} has no {key:?}: its parameter is {:?}", kind.parameter)),
            }
        }
        Ok(fault)
    }

    /// Begins it if its moment has come; returns whether it began now.
    pub(crate) fn look(&mut self, moment: &WorldMoment) -> bool {
        let due = self.fired_s.is_none()
            && moment.press >= self.at_press
            && moment.now_s >= self.at_s
            && self.at_force_n.is_none_or(|force_n| moment.force_n >= force_n)
            && self.at_height_mm.is_none_or(|height_mm| moment.height_mm <= height_mm);
        if due {
            (self.fired_s, self.fired_press) = (Some(moment.now_s), moment.press);
        }
        due
    }

    /// Whether it acts at a time.
    pub(crate) fn acts(&self, now_s: f64) -> bool {
        self.fired_s.is_some_and(|fired_s| now_s - fired_s <= self.for_s)
    }
}
