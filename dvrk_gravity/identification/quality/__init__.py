"""How far an identified model can be trusted."""
