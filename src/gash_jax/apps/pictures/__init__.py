"""Pictures: ray-cast views, figures, sheets of panels."""
