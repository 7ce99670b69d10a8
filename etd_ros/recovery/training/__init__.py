"""Training of the compact network and of SiamFC on simulated sequences; never imported by the trackers."""
