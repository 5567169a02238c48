"""Identification from trajectories."""
