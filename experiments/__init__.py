"""Claims that were measured, a folder each. From the repository root: `.venv/bin/python -m experiments.FOLDER.NAME`."""
