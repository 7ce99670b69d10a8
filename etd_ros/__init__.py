"""Boxes from event cameras: ATSLTD frames, tracking by detection, recovery on reconstructed images."""
