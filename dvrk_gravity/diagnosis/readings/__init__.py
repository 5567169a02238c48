"""Readings that are wrong: found by the model, corrected before anything is inferred."""
