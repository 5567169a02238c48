"""The demonstration: simulator, compensator and watchdog as separate processes."""
