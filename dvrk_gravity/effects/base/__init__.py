"""What effects are made of and share: no effect is here, and none is known by its name."""
