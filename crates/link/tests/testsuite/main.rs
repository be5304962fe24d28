//! The integration tests of `retrace-link`, in one binary, which links once.

mod card_frames;
mod decoder;
mod dice;
mod ends;
mod frames;
mod host_frames;
mod predicted_window;
mod serial_card;
mod texts;
mod wire;
mod works;
