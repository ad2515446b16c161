# `make run`, `make test` and `make check` build .venv/ when it is missing or out of date.
PYTHON ?= python3
BIN := .venv/bin

PACKAGES := .ci/packages linux.uml=user-mode-linux tcc=tcc insmod=kmod ip=iproute2 candump=can-utils

.PHONY: run test vcan fast check lint clean

run: .venv/ready
	$(BIN)/preshape run --scenario sim_backend/scenarios/tea_box.toml --seed 0

# The bus tests run on a real vcan: in a guest (user-mode Linux) where this kernel has none, watched by candump.
test: .venv/ready
	$(PACKAGES)
	$(BIN)/pytest -q --numprocesses auto --dist loadfile --no-loadscope-reorder -m "not guest"

# The first grasp on a real vcan: minutes, and alone, for it goes by the machine's clock.
vcan: .venv/ready
	$(PACKAGES)
	$(BIN)/pytest -q -m guest

fast: .venv/ready
	$(BIN)/pytest -q --numprocesses auto -m "not slow and not physics and not bus"

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

check: lint fast

.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf .venv build src/*.egg-info
