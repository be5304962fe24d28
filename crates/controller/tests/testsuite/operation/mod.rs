//! Operation, from the operator's command to the card's motion: the threads of a job, reverse run to a target, resuming
//! a job where it was left.

mod back;
mod index;
mod jobs;
mod pause;
mod program_override;
mod release;
mod resume;
mod still;
mod stuck_output;
