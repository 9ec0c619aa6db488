# The two ways in: `make demo` and `make test`. Everything they need goes into .venv and target/.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
WORKERS := $(shell expr 1 + $$(getconf _NPROCESSORS_ONLN))
unexport MAKEFLAGS MFLAGS # in which cargo looks for a job server
ifdef PIP_INDEX_URL # a mirror
export UV_DEFAULT_INDEX := $(PIP_INDEX_URL)
endif
unexport PYTHONDONTWRITEBYTECODE # hundreds of tests start the command, and each would compile the package anew
RUST_SOURCES := Cargo.toml Cargo.lock $(shell find rust -name '*.rs' -o -name 'Cargo.toml')

.PHONY: demo test test-rust test-python test-processes lint bench cases arena docs lock surface release wheel clean

demo: $(VENV)/built
	rm -rf demo-case1
	$(BIN)/bess run case1 --out demo-case1

test: test-rust test-python test-processes

test-rust:
	cargo test --locked

# On every core and one more, as some tests wait.
test-python: $(VENV)/built
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m 'not slow and not process and not browser'

# Those that start processes or a browser, a file at a time.
test-processes: $(VENV)/built
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -m 'not slow and (process or browser)' \
		$$(grep -lrE 'mark\.(process|browser)' --include='test_*.py' tests)

lint: $(VENV)/built
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/typos
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32
	$(BIN)/actionlint
	$(BIN)/zizmor --offline --quiet .github
	$(BIN)/python .ci/licences.py --check
	cargo fmt --check
	cargo clippy --workspace --all-targets --locked -- -D warnings

# The rivals are optional: what cannot be installed is a row of the table that says so.
bench: $(VENV)/built
	-$(BIN)/python -m pip install --quiet --group bench
	-$(BIN)/python -m pip install --quiet --no-deps --ignore-requires-python simses==2.1.1
	cargo bench --locked
	$(BIN)/python -m pytest benches -o addopts= --benchmark-only
	$(BIN)/python benches/table.py

# Runs the studies of the documentation (a minute or two) and writes the numbers, tables and figures that its pages show.
cases: $(VENV)/built
	rm -rf results/cases
	$(BIN)/python docs/make_cases.py results/cases
	$(BIN)/python docs/make_ageing.py
	$(BIN)/python docs/make_midpoint.py
	$(BIN)/python examples/m5bat_live.py ../shared/data --table docs/_cases/m5bat-live.md
	$(BIN)/python docs/make_cooling.py
	$(BIN)/python docs/make_services.py

# Every rule and mpc in every scenario of the arena (some minutes), and the tables of arena.md.
arena: $(VENV)/built
	$(BIN)/python benches/arena.py --page
	$(BIN)/python benches/distilled.py --table

docs: $(VENV)/built
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

$(VENV)/tools: pyproject.toml Makefile
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet 'maturin>=1.9.4,<2' 'uv>=0.9'
	touch $@

# An editable install: the Python sources are used in place, the Rust core is compiled into them. uv, which compiles
# bytecode only if asked to, takes less than half of the time of pip.
$(VENV)/built: export VIRTUAL_ENV := $(CURDIR)/$(VENV)
$(VENV)/built: export UV_COMPILE_BYTECODE := 1
$(VENV)/built: export UV_CONSTRAINT := .ci/constraints.txt
$(VENV)/built: $(VENV)/tools .ci/constraints.txt $(RUST_SOURCES)
	$(BIN)/uv pip install --quiet --group dev --group docs
	$(BIN)/maturin develop --release --locked --extras all --uv
	touch $@

# The newest versions of everything that `make` installs, on every supported Python and system, written down so that
# the next ones install the same.
lock: $(VENV)/tools
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --no-header --no-annotate \
		--all-extras --group dev --group docs --group wheels --output-file .ci/constraints.txt pyproject.toml

# Stores the public surface as it is now (docs/stability.md).
surface: $(VENV)/built
	$(BIN)/python tests/surface.py

# Writes the version given wherever it stands, and closes the change log; a tag then does the rest (.github/workflows/release.yml).
release: surface
	$(BIN)/python .ci/release.py cut $(VERSION)

# One wheel, as the release builds it: make wheel TARGET=x86_64-unknown-linux-gnu (after `rustup target add`).
wheel: $(VENV)/tools
	$(BIN)/python -m pip install --quiet --group wheels
	PATH="$(CURDIR)/$(BIN):$$PATH" .ci/wheel $(TARGET)
	PATH="$(CURDIR)/$(BIN):$$PATH" .ci/audit dist

clean:
	rm -rf $(VENV) target docs/_build
