# `make demo` and `make test` set everything up in .venv first; nothing but Python >= 3.11 and make is needed.
PYTHON ?= python3
VENV   := .venv
MESH   ?=
LIGHT  ?=
STAMP  := $(VENV)/.installed

.PHONY: demo test peers install-check setup lock clean

setup: $(STAMP)

$(STAMP): pyproject.toml $(wildcard requirements/*.txt)
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 11) <= v <= (3, 13) else f"error: gash_jax needs Python 3.11, 3.12 or 3.13, this is {v[0]}.{v[1]}: make PYTHON=python3.12 ...")'
	@test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	@echo "installing the locked packages into $(VENV) (1-2 minutes)"
	@$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
	  -r requirements/$$($(VENV)/bin/python -c 'import sys; print("lock-%d.%d.txt" % sys.version_info[:2])')
	@$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $(STAMP)

demo: $(STAMP)
	@$(VENV)/bin/gash demo $(if $(MESH),--mesh "$(MESH)") $(if $(LIGHT),--light "$(LIGHT)") -o demo

# the checks of the source beside the tests; what fails does not stop the rest, and is named at the end
test: $(STAMP)
	@$(MAKE) --no-print-directory --keep-going --jobs 2 source suite

.PHONY: source suite
source:
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/lint-imports
	$(VENV)/bin/pyright

suite:
	$(VENV)/bin/python -m pytest -m "not optimised"; code=$$?; \
	$(VENV)/bin/python -m pytest -m optimised $$(grep -rl mark.optimised tests --include=test_*.py) && exit $$code

# our attention layers against PyTorch Geometric's, rotations against e3nn's, light that bounces against Mitsuba's, live;
# torch is heavy, so they have an environment of their own
PEERS := $(VENV)-peers
peers: $(PEERS)/.installed
	$(PEERS)/bin/python -m pytest -n 0 tests/peers

$(PEERS)/.installed: $(STAMP) requirements/peers.txt
	@test -x $(PEERS)/bin/python || $(PYTHON) -m venv $(PEERS)
	@echo "installing the locked packages, PyTorch Geometric, e3nn and Mitsuba into $(PEERS) (3 minutes)"
	@$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check -r requirements/peers.txt \
	  -r requirements/$$($(PEERS)/bin/python -c 'import sys; print("lock-%d.%d.txt" % sys.version_info[:2])')
	@$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

# the wheel in clean environments with its dependencies from the index, on every Python from 3.11 to 3.13 that is here
install-check: $(STAMP)
	GASH_INSTALL=whole $(VENV)/bin/python -m pytest -n 0 -v tests/test_install.py

# rewrite the lock files from the ranges in pyproject.toml (needs uv)
lock:
	for v in 3.11 3.12 3.13; do uv pip compile --quiet --no-header --no-annotate --universal \
	  --python-version $$v --group dev pyproject.toml -o requirements/lock-$$v.txt; done

clean:
	rm -rf $(VENV) $(PEERS) demo out runs
