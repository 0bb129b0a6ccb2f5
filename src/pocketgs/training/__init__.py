"""Training: preparation, seeding, recipes, planning and the training loop."""
