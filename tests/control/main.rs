//! How a press is controlled: the state machine alone, and whole runs with specimens, links and load cells that aren't as declared.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod asked_to_stop;
mod bench_ills;
mod causes;
mod drags;
mod drifting_cell;
mod false_alarms;
mod false_trips;
mod families;
mod faults;
mod finishing;
mod first_descent;
mod forgetting;
mod gain;
mod glitches;
mod host;
mod machine;
mod missed;
mod printer;
mod random_rigs;
mod reaction;
mod rehearsals;
mod safety;
mod slow_lines;
mod sound_runs;
mod sparse_plans;
mod spring_world;
mod stiff;
mod tilt;
mod trips;
mod uncertainty;
mod unzeroed;
mod virtual_time;
mod wire_faults;
mod without_load_cell;
