"""Notebooks to read and to run, and what executes them: `.venv/bin/python -m notebooks.execute` from the root."""
