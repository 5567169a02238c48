"""Findings as typed values, and the model that carries them."""
