"""Labelled sequences, as their publishers give them or in folders of a user's own."""
