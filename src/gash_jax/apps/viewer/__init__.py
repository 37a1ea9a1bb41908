"""The page that shows transfer under light: what it holds (`contents`, `moving`), how it is made (`page`)."""
