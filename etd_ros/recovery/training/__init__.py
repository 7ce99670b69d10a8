"""Training of the compact network on simulated sequences; imported by `train` only, never by the trackers."""
