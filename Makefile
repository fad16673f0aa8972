# Two commands do all the set-up: `make demo` and `make test`. The environment is .venv in this folder.
PYTHON ?= python3
PIP = .venv/bin/pip install --quiet --quiet --disable-pip-version-check -c constraints.txt
export GOMP_SPINCOUNT = 2000
export SDL_VIDEODRIVER ?= dummy

.PHONY: demo test lint docs wheel clean

demo: .venv/installed
	OMP_NUM_THREADS=1 .venv/bin/tvae demo --out runs/demo --force

test: .venv/installed-test
	OMP_NUM_THREADS=1 .venv/bin/pytest --numprocesses 2 --cov --cov-branch --cov-report term:skip-covered --cov-fail-under 90

lint: .venv/installed-lint
	.venv/bin/ruff check .
	.venv/bin/mypy
	.venv/bin/lint-imports

# The site: open build/docs/index.html. A warning is an error.
docs: .venv/installed-docs
	.venv/bin/sphinx-build --fresh-env --fail-on-warning --keep-going --quiet --builder html docs build/docs

# The wheel must work by itself, in an environment that has nothing else.
wheel: .venv/installed-test
	rm -rf dist build/empty
	.venv/bin/python -m build --wheel
	$(PYTHON) -m venv build/empty
	build/empty/bin/pip install --quiet --quiet --disable-pip-version-check -c constraints.txt dist/*.whl
	cd build && empty/bin/python -c 'import tvae; tvae.TrajectoryVAE' && empty/bin/tvae --help > /dev/null
	rm -rf build/empty

clean:
	rm -rf .venv build dist

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/installed: pyproject.toml constraints.txt | .venv/bin/python
	$(PIP) -e .
	touch $@

.venv/installed-test: .venv/installed
	$(PIP) -e '.[test]'
	touch $@

.venv/installed-lint: .venv/installed-test
	$(PIP) -e '.[lint]'
	touch $@

.venv/installed-docs: .venv/installed-test
	$(PIP) -e '.[docs]'
	touch $@
