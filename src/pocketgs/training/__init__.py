"""From a capture to a trained scene: preparation, seeding, recipes, planning and the loop."""
