"""Speed, and error against rays; never in a test. From the root: `.venv/bin/python -m benchmarks.NAME --help`."""
