# Every target sets up what it needs: .venv with the locked dependencies. `make demo` and `make test` are the two to know.

BIN := .venv/bin
#: of the demo: `make demo SIZE=--small`
SIZE ?=
#: processes that run tests side by side: `make test PROCESSES=8`
PROCESSES ?= 2
# Whole files go to a process, so that what a file makes once is made once. Two threads show whether threads change
# a byte; those that wait leave their core to others.
PYTEST := OMP_WAIT_POLICY=passive NUMBA_NUM_THREADS=2 $(BIN)/python -m pytest -q -n $(PROCESSES) --dist loadfile
.PHONY: demo test plain hard-cases package site lint docs lock setup clean

demo: .venv/.ready  ## the whole job on a built-in synthetic capture; ends with demo/report/report.html
	$(BIN)/ibrpipe demo $(SIZE) --out demo

test: .venv/.ready  ## all tests
	$(PYTEST)

# A picture takes a thousand times as long without the compiler: of each test three variants show that indices stay inside
# and what the kernels mean. Left out, each with its reason: a whole sweep of PatchMatch (minutes; half a sweep is in), and
# six tests of what is compiled beforehand and cached (with the compiler off nothing is).
plain: .venv/.ready  ## the kernels' and renderers' tests with Numba's compiler off: what they do as plain Python
	NUMBA_DISABLE_JIT=1 $(PYTEST) --variants 3 tests/core tests/renderers

hard-cases: .venv/.ready  ## every hard case with every renderer; fails where one is beyond its limit
	$(BIN)/ibrpipe bench hard-cases --out bench

package: .venv/.ready  ## sdist and wheel in dist/; the wheel in a new environment, and the small demo from there
	.ci/package

# The pages keep their places beside one another, so that links work in the checkout and in the site alike.
site: demo  ## docs/ as a site with the demo's page inside: build/site/html/index.html; fails where a link leads nowhere
	rm -rf build/site
	mkdir -p build/site/pages
	cp -r README.md CHANGELOG.md LICENSE docs data_specs pipelines build/site/pages
	$(BIN)/ibrpipe export demo build/site/pages/docs/demo.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

lint: .venv/.ready  ## style, types, import rules, generated files up to date
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/generate.py --check

docs: .venv/.ready  ## write docs/cli.md and data_specs/*.schema.json anew
	$(BIN)/python docs/generate.py

lock: .venv/.ready  ## write requirements.lock from what .venv holds
	$(BIN)/python .ci/lock.py

setup: .venv/.ready

.venv/.ready: requirements.lock pyproject.toml .ci/setup
	@.ci/setup

clean:  ## remove the environment, caches and the demo
	rm -rf .venv demo bench build dist failed-pictures .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
