# make bake     set up .venv, bake the sample apartment, write out/ (a baked .blend, a picture, a summary)
# make test     set up .venv and run the tests
# make lint     style and format
# make wheels   package and add-on tests in Blender 4.2, 4.5 and 5.2 as well
# make report   measure speed against error beside Cycles (hours; QUICK=1: minutes), write docs/speed.md
# make samples  remake the .blend files of sample_scenes/
# make zip      the Blender extension, dist/enfilade-VERSION.zip
#
# PYTHON=...    the Python 3.11 to use;  BPY=...  the version of Blender's Python module

BPY = 5.0.1
VENV = .venv
PYTHON = $(shell for p in python3.11 python3 python; do "$$p" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null && command -v "$$p" && break; done)
RUN = $(VENV)/bin/python
PIP = $(RUN) -m pip --quiet --disable-pip-version-check install

.PHONY: bake test lint wheels report samples zip clean

bake: $(VENV)/.bake
	@mkdir -p out
	@$(RUN) -m enfilade bake sample_scenes/apartment.blend --out out/apartment-baked.blend --picture out/apartment.png --report out/apartment.json

test: $(VENV)/.test
	$(RUN) -m pytest

lint: $(VENV)/.test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

wheels: $(VENV)/.test
	$(RUN) tests/house/wheels.py

report: $(VENV)/.report
	$(RUN) -m enfilade.docs.report $(if $(QUICK),--quick)

# Blender 4.2 cannot open what 5.0 saves, so the committed .blend files are made with the oldest version.
samples:
	@test -x .venv-4.2/bin/python || { $(FIT); "$(PYTHON)" -m venv .venv-4.2; }
	@.venv-4.2/bin/python -m pip --quiet --disable-pip-version-check install "bpy==4.2.*" --editable .
	.venv-4.2/bin/python -m enfilade.sample_scenes.make_all --out sample_scenes

zip: $(VENV)/.bake
	$(RUN) tests/house/extension_tool.py build dist

clean:
	rm -rf .venv .venv-* out dist build enfilade.egg-info

# A sentence, not a traceback, where the machine is not fit.
FIT = if [ -z "$(PYTHON)" ]; then echo "enfilade: Python 3.11 is needed and no python3.11, python3 or python of that version is on the path; install it, or name it: make PYTHON=/path/to/python3.11 $(or $(MAKECMDGOALS),bake)" >&2; exit 2; fi; \
      "$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { echo "enfilade: $(PYTHON) cannot make virtual environments; install its venv package (Debian and Ubuntu: python3.11-venv)" >&2; exit 2; }
BPY_FIT = $(RUN) -c 'import bpy' >/dev/null 2>$(VENV)/bpy.log || { echo "enfilade: Blender's Python module does not load: $$(tail -n 1 $(VENV)/bpy.log). Its system libraries on Debian and Ubuntu: sh .ci/libraries" >&2; exit 2; }

# Each stamp is remade only when the lists of what is installed change.
$(VENV)/.bake: pyproject.toml Makefile
	@$(FIT)
	@test -x $(RUN) || { echo "making $(VENV) with $(PYTHON)"; "$(PYTHON)" -m venv $(VENV); }
	@echo "installing numpy and bpy $(BPY) into $(VENV) (a download of about 350 MB the first time)"
	@$(PIP) "bpy==$(BPY)" --editable .
	@$(BPY_FIT)
	@touch $@

$(VENV)/.report: $(VENV)/.bake
	@$(PIP) "bpy==$(BPY)" --editable ".[report]"
	@touch $@

$(VENV)/.test: $(VENV)/.bake
	@echo "installing the test tools into $(VENV)"
	@$(PIP) "bpy==$(BPY)" --editable ".[test]"
	@touch $@
