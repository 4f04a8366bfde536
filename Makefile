# `make demo` and `make test` need only Python 3.11 or later and make; everything else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
JOBS ?= 2
DEMO_ROBOTS := robot_0 robot_1 robot_2
export OPENBLAS_NUM_THREADS := 1
# Without compiled modules, each of the programs that the tests start would parse all modules again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo paper confidence figures docs site test slow check install develop clean kernel-coverage fuzz faults mutants

install: .venv/installed

.venv/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "tbmslam needs Python 3.11 or later")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	$(BIN)/python tools/warm_up.py
	touch $@

# What working on it takes besides: test tools, and every program and viewer that reads our files, some 900 MB.
develop: .venv/developed

.venv/developed: .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

# Fails early and clearly when the style, the types or the layers are broken.
check: develop
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Three simulated robots in an office, from bags to one map, held against the building that they drove through.
demo: install
	$(BIN)/python tools/make_world.py --world office --seed 1 --robots 3 -o demo/bags
	$(BIN)/python tools/build_maps.py $(addprefix demo/bags/,$(addsuffix .bag,$(DEMO_ROBOTS))) --separate \
	    --reference $(addprefix demo/bags/,$(addsuffix .truth.tum,$(DEMO_ROBOTS))) -o demo/maps
	$(BIN)/python tools/merge.py $(addprefix demo/maps/,$(DEMO_ROBOTS)) -o demo/merged
	$(BIN)/python tools/evaluate.py map demo/merged --truth demo/bags/world.npz \
	    --trajectories demo/maps/robot_0/trajectory.tum demo/bags/robot_0.truth.tum --picture demo/errors.png
	@echo 'Now look at demo/merged/report.html; the building is demo/bags/world.png, errors are in demo/errors.png.'

# The README's picture: the merged map, whose walls are whose, and the boxes that stood elsewhere when another robot came.
docs/merged-office.png: install
	mkdir -p docs
	$(BIN)/python tools/make_world.py --world office --seed 1 --robots 3 --fault furniture@0 -o demo/moved/bags
	$(BIN)/python tools/build_maps.py $(addprefix demo/moved/bags/,$(addsuffix .bag,$(DEMO_ROBOTS))) --separate \
	    -o demo/moved/maps
	$(BIN)/python tools/merge.py $(addprefix demo/moved/maps/,$(DEMO_ROBOTS)) -o demo/moved/merged
	$(BIN)/python -c "import cv2; \
	panels = [cv2.imread(f'demo/moved/merged/{name}.png') for name in ('pignistic', 'overlay', 'contradictions')]; \
	x, y, w, h = cv2.boundingRect((panels[0][..., 0] != 128).astype('uint8')); \
	row = cv2.hconcat([panel[y : y + h, x : x + w] for panel in panels]); \
	cv2.imwrite('$@', cv2.resize(row, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) // 24 * 24 + 12)"

# The README's pictures of a report, as a browser shows it; needs Chromium.
docs/pairs.png: PART := .cards
docs/report.png docs/pairs.png: demo develop
	$(BIN)/python -c "import contextlib, io, pathlib, PIL.Image; from tests.browser import browser_window; \
	stack = contextlib.ExitStack(); window = stack.enter_context(browser_window()); \
	window.goto(pathlib.Path('demo/merged/report.html').resolve().as_uri()); window.wait_for_timeout(300); \
	png = (window.locator('$(PART)').first if '$(PART)' else window).screenshot(); stack.close(); \
	PIL.Image.open(io.BytesIO(png)).convert('RGB').quantize(256).save('$@', optimize=True)"

# Two real drives of docs/accuracy.md, from the recordings in DATA: the grounds of a hospital, and an office floor.
docs/real-drives.png: install
	$(BIN)/python tools/build_maps.py $(DATA)/fr-clinic/fr-clinic.bag --no-truth -o out/real-drives/clinic
	$(BIN)/python tools/build_maps.py $(DATA)/intel-real/intel-real.bag --angle-step-deg 1.0 --no-truth -o out/real-drives/intel
	$(BIN)/python -c "import cv2; \
	maps = [cv2.imread(f'out/real-drives/{name}/pignistic.png') for name in ('clinic/fr-clinic', 'intel/intel-real')]; \
	boxes = [cv2.boundingRect((abs(one[..., 0].astype(int) - 128) > 8).astype('uint8')) for one in maps]; \
	maps = [one[y : y + h, x : x + w] for one, (x, y, w, h) in zip(maps, boxes)]; \
	maps = [cv2.resize(one, (round(500 * one.shape[1] / one.shape[0]), 500), interpolation=cv2.INTER_AREA) for one in maps]; \
	gap = cv2.copyMakeBorder(maps[1], 0, 0, 12, 0, cv2.BORDER_CONSTANT, value=(255, 255, 255)); \
	cv2.imwrite('$@', cv2.hconcat([maps[0], gap]) // 16 * 16 + 8)"

# A fleet as a graph, and the merged map of its largest group.
docs/fleet.png: develop
	$(BIN)/python tools/benchmark.py fleet 8x5 --seeds 31 --plot $@

# The pages of docs and the library's names as a site, out/site/index.html.
site: develop
	$(BIN)/python -m sphinx -W --keep-going -q -b html -c docs/site docs out/site

docs: docs/merged-office.png docs/report.png docs/pairs.png docs/real-drives.png docs/fleet.png

# Compiled code hides from coverage; here Python runs the kernels itself, and the table says which lines no test reaches.
kernel-coverage: develop
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q tests/tbmslam/kernels --cov=tbmslam.kernels \
	    --cov-report=term-missing:skip-covered --cov-fail-under=85

# Looks for bytes that a border does not survive: `make fuzz BORDER=bag SECONDS=600`; the borders are in tests/fuzzing/borders.py.
BORDER ?= npz
SECONDS ?= 60
fuzz: develop
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[fuzz]'
	$(BIN)/python tests/fuzzing/fuzz.py $(BORDER) --seconds $(SECONDS)

# The paper's tables and figures, measured anew on five simulated drives; some minutes.
paper: develop
	$(BIN)/python tools/reproduce_paper.py -o out/paper

# The confidence model, anew from the recordings and map pairs in DATA, which are no part of the repository, and from simulated
# buildings. Prints what the model is worth on each building when that was left out of the fit, and draws docs/confidence.png.
# Takes about three hours of CPU time. The confidence of deformed maps is fitted to simulated buildings only.
DATA ?= ../shared/data
BUILDINGS := ex3 lab_f lab_ipa nlb simona uma vim23 vottero
REAL = $(foreach one,$(BUILDINGS),$(subst _,-,$(one))=$(DATA)/map-pairs/crop_$(one)_100.npz) \
    $(foreach one,mit-csail intel aces,$(one)=out/confidence/$(one)/$(one))
confidence: develop
	$(BIN)/python tools/build_maps.py $(DATA)/mit-csail/mit-csail.bag -o out/confidence/mit-csail
	$(BIN)/python tools/build_maps.py $(DATA)/intel/intel.bag --angle-step-deg 1.0 -o out/confidence/intel
	$(BIN)/python tools/build_maps.py $(DATA)/aces/aces.bag --angle-step-deg 1.0 -o out/confidence/aces
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/real --parts 6 --overlap 50 35 25 15 --largest 600 \
	    --floor $(REAL)
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/simulated --seeds 900001 900002 900003 900004 --parts 2 \
	    --overlap 50 25 15 --largest 900
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/simulated --lattice 2500 --seeds 900005 900006 --overlap 50 25
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/simulated --lattice 5600 --seeds 900007 900008 --overlap 50 25
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/bent --bend 0.15 --overlap 100 50 35 --floor $(REAL)
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/bent-more --bend 0.3 --overlap 100 50 35 --floor $(REAL)
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/bent-simulated --bend 0.15 --seeds 900011 --overlap 100 50 35
	$(BIN)/python tools/make_map_pairs.py -o out/confidence/bent-simulated --bend 0.3 --seeds 900012 --overlap 100 50 35
	$(BIN)/python tools/calibrate_merging.py $(DATA)/map-pairs out/confidence/real --simulated out/confidence/simulated \
	    --bent out/confidence/bent out/confidence/bent-more out/confidence/bent-simulated --strangers 1200 \
	    --plot docs/confidence.png -o merging/confidence_model.json
	$(BIN)/python tools/calibrate_deformed.py -o merging/deformed_model.json

# The tables of README and docs: runs their benchmarks with the recordings in DATA, writes docs/figures, and fills the pages.
# `make figures ONLY="slam seeds"` measures only some; `tools/figures.py list` names all. All of them take hours.
figures: develop
	$(BIN)/python tools/figures.py measure $(ONLY) --data $(DATA)

# What the programs survive: damaged bags, sensor trouble. Fails where a row is red; `SHORT=--short` tries only some.
faults: develop
	$(BIN)/python tests/faults/faults.py $(SHORT)

# Small faults in the code, and which of them the nearest tests notice; about half an hour.
mutants: develop
	$(BIN)/python tests/mutation/mutants.py run --jobs $(JOBS)

test: develop
	$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup -m 'not slow'

slow: develop
	$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup -m slow

clean:
	rm -rf .venv demo out
