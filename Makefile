# Nacre's commands: `make help` lists them.

# Any Python from 3.9 finds the right ones and makes the virtual environments.
BOOTSTRAP := $(shell for python in python3 python3.13 python3.11 /usr/bin/python3; do \
	"$$python" -c 'import sys; sys.exit(sys.version_info < (3, 9))' 2>/dev/null \
		&& { echo "$$python"; break; }; done)
PYTHON := .venv/bin/python
CLANG_FORMAT := .venv/bin/clang-format
NATIVE_FILES := $(shell find native -name build -prune -o -name '*.[ch]pp' -print 2>/dev/null)
# What a studio tool may use without Blender, and what builds it all.
TYPED := $(wildcard $(addprefix addon/,errors.py cli.py samples.py verbs datasets models tables)) tools
NATIVE_TESTS := build/native-tests
SANITIZED_TESTS := build/native-tests-sanitized

.DEFAULT_GOAL := help
.PHONY: help setup .venv missing-packages demo test lint test-native test-sanitizers test-python acceptance fuzz bench \
	extension format clean
.NOTPARALLEL:
# Folders of other projects would shadow ours.
unexport PYTHONPATH

help: ## Show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 20

setup: ## Make .venv, and .venv-311 where both Pythons are there (done first wherever it is needed)
	@$(or $(BOOTSTRAP),python3) -m tools.setup

.venv:
	@$(or $(BOOTSTRAP),python3) -m tools.setup --main-only

missing-packages: # Print the system packages that setup would ask for
	@$(or $(BOOTSTRAP),python3) -m tools.setup --missing-packages

demo: .venv ## Compress a measured material and render it with EEVEE and Cycles into out/demo
	@$(PYTHON) -m tools.demo

test: setup lint test-native test-sanitizers test-python ## Run every check and test

lint: .venv ## Check style and types
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(CLANG_FORMAT) --dry-run -Werror $(NATIVE_FILES)
	$(PYTHON) -m mypy $(TYPED)

test-native: .venv ## Build and run the C++ tests
	$(PYTHON) -m cmake -S native -B $(NATIVE_TESTS) -G Ninja -DNACRE_TESTS=ON \
		-DCMAKE_MAKE_PROGRAM="$(CURDIR)/.venv/bin/ninja" -DPython_EXECUTABLE="$(CURDIR)/$(PYTHON)"
	$(PYTHON) -m cmake --build $(NATIVE_TESTS)
	CTEST_OUTPUT_ON_FAILURE=1 $(PYTHON) -m cmake --build $(NATIVE_TESTS) --target test

test-sanitizers: .venv ## Run the C++ tests with the address and undefined-behaviour sanitizers
	$(PYTHON) -m cmake -S native -B $(SANITIZED_TESTS) -G Ninja -DNACRE_TESTS=ON \
		-DNACRE_SANITIZE=address,undefined -DCMAKE_BUILD_TYPE=Release \
		-DCMAKE_CXX_FLAGS_RELEASE="-O1 -fno-sanitize-recover=all" \
		-DCMAKE_MAKE_PROGRAM="$(CURDIR)/.venv/bin/ninja" -DPython_EXECUTABLE="$(CURDIR)/$(PYTHON)"
	$(PYTHON) -m cmake --build $(SANITIZED_TESTS)
	CTEST_OUTPUT_ON_FAILURE=1 $(PYTHON) -m cmake --build $(SANITIZED_TESTS) --target test

test-python: setup ## Run the Python tests in each environment
	@if [ -d .venv-311 ]; then .venv-311/bin/python -m pytest; fi
	@$(PYTHON) -m pytest

# Reader by reader, ten minutes each.
fuzz: .venv ## Fuzz every reader of measured files, guided by coverage
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r requirements/fuzz.txt
	@for name in $$($(PYTHON) -c "from tests.fuzz.harness import TARGETS; print(*TARGETS)"); do \
		$(PYTHON) -m tests.fuzz "$$name" --seconds 600 || exit; done

acceptance: setup ## Run the long tests that `make test` leaves out
	$(PYTHON) -m pytest -m acceptance

bench: .venv ## Run every benchmark
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r requirements/bench.txt
	@for file in benchmarks/[!_]*.py; do $(PYTHON) -m "benchmarks.$$(basename "$$file" .py)" || exit; done

# EXTRA_WHEELS is a folder with wheels of native/ built elsewhere, for Pythons that are not here.
extension: .venv ## Build dist/nacre-VERSION.zip
	@$(PYTHON) -m tools.extension $(if $(EXTRA_WHEELS),"$(EXTRA_WHEELS)")

format: .venv ## Rewrite the sources in the project's style
	$(PYTHON) -m ruff check --fix-only --quiet .
	$(PYTHON) -m ruff format .
	$(CLANG_FORMAT) -i $(NATIVE_FILES)

clean: ## Remove what was built, but not the virtual environments
	rm -rf build dist out .hypothesis .mypy_cache .pytest_cache .ruff_cache
