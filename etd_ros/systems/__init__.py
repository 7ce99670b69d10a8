"""The systems that the tracker is compared with (paper Sec. 4): trackers of pictures and of events by name."""
