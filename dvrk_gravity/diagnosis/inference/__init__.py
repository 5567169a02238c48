"""Which effects explain the residual."""
