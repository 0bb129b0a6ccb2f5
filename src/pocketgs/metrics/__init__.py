"""Image metrics: renderings compared with photographs."""
