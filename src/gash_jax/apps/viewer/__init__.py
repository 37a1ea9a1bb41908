"""The page that shows transfer under light: what it holds (`contents`, `moving`) and how it is put together (`page`)."""
