//! Skeleton: the serial backend comes with the wire protocol; nothing is exported yet.
#![forbid(unsafe_code)]
