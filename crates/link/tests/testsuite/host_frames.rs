//! The host's endpoint alone, frame by frame.
