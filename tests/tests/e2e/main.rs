//! The end-to-end tests of the command that mostly wait, in one binary: they overlap. Those that load the computer are
//! binaries of their own beside it, which run alone.

mod analog;
#[cfg(target_os = "linux")]
mod arc;
mod beam_power;
mod card;
mod check;
mod check_answers;
mod check_contours;
mod check_costs;
mod command;
mod consumables;
mod contours;
mod cut_resume;
mod cutter;
mod dnc;
mod earlier_threads;
mod error_catalogue;
mod feed_override;
mod feed_per_turn;
mod frame;
mod hand;
mod height_control;
mod heights;
mod held_jog;
mod ignored_ok;
mod inputs;
mod jets;
mod jumps;
mod kerfs;
mod linuxcnc_programs;
mod markers;
#[cfg(unix)]
mod materials;
mod mtconnect;
mod offsets;
mod orient;
#[cfg(target_os = "linux")]
mod output;
mod page;
mod page_paths;
mod page_tables;
mod page_tls;
mod pierces;
mod probing;
mod probing_cycles;
mod probing_limits;
mod program_override;
#[cfg(target_os = "linux")]
mod ramp_pierce;
mod real_time;
mod recovery_examples;
mod refusals;
mod resume;
mod resume_files;
mod resumed_taps;
#[cfg(unix)]
mod screen;
mod sense_test;
mod serial;
mod sheet;
mod sheet_sensing;
mod shop;
mod shop_broker;
mod shop_page;
mod shop_screen;
#[cfg(unix)]
mod sparkplug;
mod speed_override;
mod spindle_ready;
#[cfg(unix)]
mod start_points;
#[cfg(unix)]
mod state_files;
mod state_socket;
mod step_test;
mod stop_signals;
mod streams;
mod surface_speed;
mod taps;
mod thread_hold;
mod threads;
mod tip_up;
mod tool_change;
mod tool_length;
