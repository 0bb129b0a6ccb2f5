"""How close renderings are to photographs."""
