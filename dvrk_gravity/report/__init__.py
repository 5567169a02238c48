"""Findings and fits as pages that a person reads: HTML in one file, no network."""
