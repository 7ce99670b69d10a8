"""Boxes from event cameras: ATSLTD frames, tracking by detection, recovery on reconstructed images."""

from etd_ros.kernel_cache import choose_kernel_cache

choose_kernel_cache()
