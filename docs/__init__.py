"""The documents, and what generates tables and figures in them: `.venv/bin/python -m docs` from the repository root."""
