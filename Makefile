# Everything a newcomer runs. VENV names the Python environment; it is made when it is missing.
VENV ?= .venv
PYTHON ?= python3
BIN = $(VENV)/bin

# Of what is installed only the modules that are used are compiled, and then. Pip shows how far it is.
INSTALL = $(BIN)/python -m pip install --disable-pip-version-check --no-compile --editable

# Examples in prose are laid out for reading.
FORMAT = $(BIN)/ruff format --exclude '*.md' .

# Pictures are drawn without a screen.
ifeq ($(shell uname),Linux)
export MUJOCO_GL ?= egl
endif

# Bytecode is kept: each of the processes that tests start would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo setup test tests thorough quick format lint typecheck schemas catalogue audit-docs traces site validate validate-share gallery blind-study learned learned-campaign corpus learned-sheets fuzz faults matrix

demo: $(BIN)/safestage-score  ## score the recorded episodes; needs no simulator
	$(BIN)/safestage-score traces/ --rules rules/

test: lint typecheck tests  ## all checks; side by side with make -j 3 test

tests: $(BIN)/pytest  ## the tests, slow ones included
	$(BIN)/pytest -n 2 --dist worksteal --durations 20

thorough: $(BIN)/pytest  ## the tests with every case of what they otherwise take a share of
	SAFESTAGE_ALL_CASES=1 $(BIN)/pytest -n 2 --dist worksteal --durations 20

quick: $(BIN)/pytest  ## for every save: one case of each fast test of what a verdict is made of
	$(BIN)/pytest -n 2 --dist worksteal --quick

setup:  ## the environment for working on SafeStage, simulator and tools included
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) '.[dev]'

format: $(BIN)/pytest  ## lay out the code
	$(FORMAT)
	$(BIN)/ruff check --fix .

lint: $(BIN)/pytest
	$(FORMAT) --check
	$(BIN)/ruff check .

typecheck: $(BIN)/pytest
	$(BIN)/mypy

schemas: $(BIN)/pytest  ## write schemas/ anew from the code
	$(BIN)/python -m safestage_eval.formats.trace_schema schemas
	$(BIN)/python -m safestage_eval.rules.schema schemas
	$(BIN)/python -m safestage_eval.report.result_schema schemas

catalogue: $(BIN)/pytest  ## write docs/catalogue.md anew from the rules
	$(BIN)/python -m safestage_eval.report.catalogue docs/catalogue.md

audit-docs: $(BIN)/pytest  ## write docs/audit.md anew from the checks
	$(BIN)/python -m safestage_eval.report.audit_page docs/audit.md

site: $(BIN)/pytest  ## build the documentation site into build/site; links and anchors are checked
	$(BIN)/mkdocs build --strict

traces: $(BIN)/pytest  ## record the episodes in traces/ that are not there yet
	$(BIN)/safestage bench record --out traces

validate: $(BIN)/pytest  ## run both references of every task on three seeds, judge them, write docs/feasibility.md
	$(BIN)/safestage bench tasks validate --write docs/feasibility.md
	$(BIN)/safestage bench tasks validate --grades --seeds 0

SHARE ?= 1/6
validate-share: $(BIN)/pytest  ## the same for a share of the tasks: SHARE=2/6 is every sixth from the second on
	$(BIN)/safestage bench tasks validate --share $(SHARE)
	$(BIN)/safestage bench tasks validate --share $(SHARE) --grades --seeds 0

gallery: $(BIN)/pytest  ## draw every task, and write docs/gallery.md
	$(BIN)/safestage bench tasks gallery

INPUTS ?= 20000
SEED ?= $(shell date +%s)
JOBS ?= $(shell nproc)
fuzz: $(BIN)/pytest  ## hostile inputs of every format by the oracle: a new seed each time; what is found is kept in build/fuzz
	$(BIN)/python benchmarks/fuzz.py --seed $(SEED) --inputs $(INPUTS) --jobs $(JOBS) \
	  --keep build/fuzz --write docs/security.md

KILLS ?= 200
faults: $(BIN)/pytest  ## kill everything that writes, starve it and lock it out, and write docs/reliability.md
	$(BIN)/python tests/faults/fault_campaign.py --kills $(KILLS) --write docs/reliability.md

matrix:  ## install the wheel on every Python that is here and in hard places, and score traces/ in each
	$(PYTHON) tests/package/install_matrix.py --write docs/reliability.md

STUDY ?= study
blind-study: $(BIN)/pytest  ## record a noisy corpus, and draw 240 rollouts of it to be read (docs/labels.md)
	for noise in 0.03 0.06 0.1; do \
	  $(BIN)/safestage bench record --seeds 0-2 --policy noisy:$$noise --policy noisy:$$noise:unsafe \
	    --out $(STUDY)/corpus || true; \
	done  # what the noisy arm cannot reach is not recorded, and said
	$(BIN)/safestage score $(STUDY)/corpus -f parquet -o $(STUDY)/rows.parquet
	$(BIN)/python benchmarks/blind_study.py $(STUDY)/rows.parquet -o $(STUDY)/list.csv
	$(BIN)/safestage label sheets draw $(STUDY)/corpus --list $(STUDY)/list.csv --out $(STUDY)/sheets

LEARN ?= build/learn
LEARN_ON ?= cpu
learned: $(BIN)/pytest  ## record demonstrations, train the shipped policies anew (LEARN_ON=cuda: on a GPU)
	$(INSTALL) '.[learn]'
	$(BIN)/safestage bench record --policy demonstration:safe --policy demonstration:unsafe --seeds 0-24 \
	  --horizon 45 --out $(LEARN)/demos || true  # the arm cannot follow every push; what failed is said
	test -d $(LEARN)/dataset || $(BIN)/safestage bench learn export $(LEARN)/demos --out $(LEARN)/dataset
	for kind in bc act diffusion; do \
	  $(BIN)/safestage bench learn train $$kind --data $(LEARN)/dataset --device $(LEARN_ON) \
	    --out simulate/learn/checkpoints/$$kind.onnx || exit 1; \
	done

learned-campaign: $(BIN)/pytest  ## roll the shipped policies out, and write docs/learned_policies.md
	$(BIN)/safestage bench record --campaign campaigns/learned.toml --out $(LEARN)/rollouts
	$(BIN)/safestage bench record --policy learned:bc --prompt all --seeds 100-102 --horizon 45 \
	  --out $(LEARN)/rollouts
	$(BIN)/safestage score $(LEARN)/rollouts --assigned -f parquet -o $(LEARN)/rows.parquet
	$(BIN)/python benchmarks/learned_page.py $(LEARN)/rows.parquet docs/learned_policies.md

corpus: $(BIN)/pytest  ## pack the rollouts of the campaign to be published, with their rows
	$(BIN)/safestage convert pack $(LEARN)/rollouts --out $(LEARN)/corpus --by policy --licence cc-by-4.0 \
	  --title 'SafeStage: rollouts of small learned policies'
	$(BIN)/safestage score $(LEARN)/corpus -f parquet -o $(LEARN)/corpus/rows.parquet

learned-sheets: $(BIN)/pytest  ## draw 120 of these rollouts to be labelled blindly
	$(BIN)/python benchmarks/blind_study.py $(LEARN)/rows.parquet --count 120 -o $(LEARN)/blind.csv
	$(BIN)/safestage label sheets draw $(LEARN)/rollouts --list $(LEARN)/blind.csv --hide-success \
	  --out $(LEARN)/sheets

$(BIN)/safestage-score:
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) .

$(BIN)/pytest:
	$(MAKE) setup
