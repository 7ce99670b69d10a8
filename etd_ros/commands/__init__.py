"""The commands of `python -m etd_ros`, one module each."""
