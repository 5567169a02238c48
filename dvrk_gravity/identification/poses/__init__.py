"""Identification from static poses."""
