//! From calibrations to contacts: the solvers, and the numbers that they must reach.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod acceptance;
mod adapt;
mod adapt_pairs;
mod by_load;
mod causes;
mod choice;
mod design;
mod drags;
mod evaluate;
mod faulty;
mod forces;
mod golden;
mod history;
mod missing;
mod over_time;
mod paper;
mod real_skins;
mod sensor_file;
mod serve;
mod skin;
mod solve;
mod solvers;
mod two_contacts;
mod vector;
mod verdict;
