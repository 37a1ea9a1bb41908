"""`python -m gash_jax` is `gash`."""

from gash_jax.apps.cli import main

if __name__ == "__main__":
    main()
