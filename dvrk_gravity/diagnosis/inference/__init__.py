"""Which readings and which effects explain the residual."""
