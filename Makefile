# Panelprep: `make demo` and `make test` are enough; both do the set-up.

PACKAGES := build-essential pkg-config libopencv-dev clang libclang-dev libaravis-dev libusb-1.0-0-dev
DEMO_OUT := target/demo

.PHONY: browser preflight sparkplug-peers opcua-peer deny mutants fuzz bench-damage code-lines package package-test zivid zivid-stub help setup demo demo-plant test test-rest test-long fixtures bench bench-seeds bench-robots bench-inspect bench-link bench-calib bench-wrong-inputs bench-real bench-surface bench-nominal bench-locate bench-worker bench-cameras bench-recording bench-manual bench-world bench-history bench-removal bench-tool-faults bench-treat bench-office bench-soak bench-cable bench-mutations bench-table

help:
	@echo 'make demo    run a whole cycle on the simulated cell, write $(DEMO_OUT)/index.html'
	@echo 'make demo-plant  two simulated cells, brokers, database, archive and the page over all cells, on this computer'
	@echo 'make test    format check, lints, the tests'
	@echo 'make test-rest  the long tests of tests/long.txt, which make test leaves out; CI runs both'
	@echo 'make test-long  test-rest, more random walks, and the tests that take minutes'
	@echo 'make package a Debian package for the system of this machine; make package-test installs, upgrades and purges it in a folder'
	@echo 'make bench   the sweeps behind the numbers in tests/bench/README.md, and their table there; one part alone: make bench-seeds, bench-robots, bench-locate, bench-inspect, bench-damage, bench-link, bench-calib, bench-wrong-inputs, bench-surface, bench-nominal, bench-worker, bench-cameras, bench-recording, bench-manual, bench-world, bench-history, bench-removal, bench-tool-faults, bench-treat, bench-office. Not part of it, since they run by the wall clock or for hours: make bench-cable, bench-soak, bench-mutations. After a single part: make bench-table'
	@echo 'make deny    licences, duplicates, sources and known faults of all crates; make mutants: changes of the code that no test detects'
	@echo 'make code-lines  lines of code by crate, today and of the commits COMMITS'
	@echo 'make fuzz    search for bytes that break a reader, SECONDS=60 each; only one: make fuzz-krl SECONDS=600'
	@echo 'make zivid   build the Zivid camera library; the SDK must be installed'
	@echo 'make fixtures  record the cycles in fixtures/ again; `make test` replays them'
	@echo 'make setup   install missing Debian packages; the other targets call it'

setup:
	@command -v cargo >/dev/null || { \
	  echo 'cargo is missing: install Rust 1.95 or newer (https://rustup.rs), then try again.' >&2; exit 1; }
	@if command -v dpkg-query >/dev/null && command -v apt-get >/dev/null; then \
	  missing=''; \
	  for package in $(PACKAGES); do \
	    dpkg-query -W -f '$${Status}' "$$package" 2>/dev/null | grep -q 'install ok installed' || missing="$$missing $$package"; \
	  done; \
	  if [ -n "$$missing" ]; then \
	    echo "Installing:$$missing"; \
	    if [ "$$(id -u)" = 0 ]; then as_root=''; elif command -v sudo >/dev/null; then as_root='sudo'; else \
	      echo "As root, run: apt-get install$$missing" >&2; exit 1; fi; \
	    $$as_root apt-get update -q && \
	    $$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $$missing; \
	  fi; \
	elif pkg-config --atleast-version=4.5 opencv4 2>/dev/null && pkg-config --atleast-version=0.8.25 aravis-0.8 2>/dev/null && \
	  command -v clang >/dev/null; then \
	  echo 'Not a Debian system; OpenCV, Aravis and clang are installed.'; \
	else \
	  echo 'This is not a Debian system. Install with its own package manager: a C++ compiler, pkg-config,' >&2; \
	  echo 'OpenCV 4.5 and Aravis 0.8.25 or newer with their headers, libusb, clang and libclang (Fedora: gcc-c++ pkgconf' >&2; \
	  echo 'opencv-devel aravis-devel libusb1-devel clang-devel; Arch: base-devel opencv aravis libusb clang), then try again.' >&2; exit 1; \
	fi

# The browser test of the operator's page needs node, npm and chromium, which are not installed for it: without them it reports that
# it did not run.
browser:
	@if command -v npm >/dev/null && command -v chromium >/dev/null && [ ! -d target/browser/node_modules/axe-core ]; then \
	  mkdir -p target/browser && npm install --silent --no-save --no-audit --no-fund --prefix target/browser \
	    playwright-core@1.65.1 axe-core@4.14.1 || echo 'playwright-core and axe-core could not be installed: the browser test will not run' >&2; \
	fi

# Independent host applications of MQTT Sparkplug, for its tests; each in a separate environment, since they need different
# versions of the same library. Without python3, pip or the broker mosquitto the tests report that they did not run.
sparkplug-peers:
	@for peer in pysparkplug:pysparkplug==0.6.1 wrapper:mqtt-spb-wrapper==2.1.2; do \
	  folder=target/sparkplug/$${peer%%:*}; \
	  if [ ! -x $$folder/bin/python3 ]; then \
	    python3 -m venv $$folder && $$folder/bin/pip install --quiet --disable-pip-version-check $${peer#*:} || \
	      { rm -rf $$folder; echo "$${peer#*:} could not be installed: a test of MQTT Sparkplug will not run" >&2; }; \
	  fi; \
	done

# An independent validator of the record's PDF, for its test, if a Java compiler already exists. Without it the test reports that it did not run.
PREFLIGHT := libpdfbox2-java libactivation-java libjaxb-api-java
preflight:
	@if command -v javac >/dev/null && command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ] && \
	  ! dpkg-query -W $(PREFLIGHT) >/dev/null 2>&1; then \
	  env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $(PREFLIGHT) >/dev/null || \
	    echo 'Apache PDFBox could not be installed: a test of the PDF will not run' >&2; \
	fi

# The OPC UA client of the tests, in a separate Python environment; if it cannot be installed, its tests report that they did not run.
OPCUA_PEER := target/opcua
opcua-peer:
	@test -x $(OPCUA_PEER)/bin/python || { \
	  python3 -m venv $(OPCUA_PEER) && $(OPCUA_PEER)/bin/pip install --quiet 'asyncua==2.1.0'; } || { \
	  rm -rf $(OPCUA_PEER); echo 'The Python package asyncua cannot be set up: the tests with an OPC UA client will not run.' >&2; }

# The development build: it takes two thirds of a release's processor time, gives the same results to the digit, and `make test` uses its crates again.
demo: setup
	@echo 'Building; the first time this downloads 52 MB of crates and takes 7 to 10 minutes on two cores. Then the cycle runs for a minute.'
	cargo build --locked
	$(BUILT)/debug/panelprep demo --out $(DEMO_OUT)

# Two simulated cells, the brokers of NATS and MQTT, PostgreSQL, the archive and the office's page on this computer, until Ctrl-C. Needs nats-server,
# postgresql, mosquitto and mosquitto-clients of Debian.
demo-plant: setup
	cargo build --release --locked --features plant
	sh tests/plant/demo.sh $(BUILT)/release/panelprep target/plant

# Some tests wait for a watchdog or a cable, and some compute: three at a time keep two cores busy. test-rest runs those of
# tests/long.txt.
LONG := $(shell sed '/^\#/d' tests/long.txt)
# A cycle by the wall clock misses its deadlines if other tests use both cores.
ALONE := $(filter rehearsal::%,$(LONG))
# Only one camera of GigE Vision can use this computer's port: these tests wait for each other, and compute nothing meanwhile. In parallel
# with all others they cost no time.
WAITING := gige::tests a_flange_picture_over_gige_is_the_one_without
WAITING_LOG = $(BUILT)/tests-of-gige-vision.log
test: setup browser preflight sparkplug-peers opcua-peer
	cargo fmt --all --check
	cargo clippy --locked --features plant --all-targets -- -D warnings
	@cargo test --locked --features plant --no-run
	@echo "the tests except the $(words $(LONG)) of tests/long.txt; those of GigE Vision in parallel, see $(WAITING_LOG)"
	@cargo test --locked --features plant --lib -- $(WAITING) >$(WAITING_LOG) 2>&1 & waiting=$$!; \
	  RUST_TEST_THREADS=3 cargo test --locked --features plant -- $(addprefix --skip ,$(LONG) $(WAITING)); others=$$?; \
	  wait $$waiting && tail -n 2 $(WAITING_LOG) || { cat $(WAITING_LOG); exit 1; }; exit $$others

test-rest: setup browser preflight sparkplug-peers opcua-peer
	@echo "the $(words $(LONG)) tests of tests/long.txt"
	@RUST_TEST_THREADS=3 cargo test --locked --features plant --test all -- $(filter-out $(ALONE),$(LONG))
	@cargo test --locked --features plant --test all -- $(ALONE)
	@echo 'the program without the parts that can be left out'
	@cargo clippy --locked -- -D warnings
	@cargo clippy --locked --no-default-features -- -D warnings

# More walks of the link and of the controller's programs, and the tests that take minutes.
test-long: test-rest
	LINK_WALKS=20000 KRL_WALKS=5000 RUST_TEST_THREADS=2 cargo test --locked --features plant --test all -- no_walk_
	RUST_TEST_THREADS=2 cargo test --locked --features plant -- --ignored --skip appends_until_killed --skip signs_until_killed --skip the_manual_leads

# Licences, duplicates, sources, and advisories if their database can be reached: deny.toml. A check that was not run is reported.
CARGO_DENY := target/tools/bin/cargo-deny
$(CARGO_DENY):
	cargo install --locked --quiet --root target/tools --target-dir $(BUILT)/cargo-deny --version '^0.20' cargo-deny

deny: $(CARGO_DENY)
	$(CARGO_DENY) --locked check licenses bans sources
	@$(CARGO_DENY) --locked check advisories || { \
	  $(CARGO_DENY) --locked fetch db >/dev/null 2>&1 && exit 1; \
	  echo 'advisories: not run, their database cannot be reached from here; run make deny on a network that reaches it' >&2; }

# Changes of the code one by one, each of which must turn a unit test red (.cargo/mutants.toml lists them). All of them take a
# day, so a run does one of 24 parts: make mutants PART=7; only one file: make mutants MUTANTS='--re src/cell/cycle/step.rs'.
# The crates are built once in the folder of the build; the changed copy is built without optimization.
CARGO_MUTANTS := target/tools/bin/cargo-mutants
$(CARGO_MUTANTS):
	cargo install --locked --quiet --root target/tools --target-dir $(BUILT)/cargo-mutants --version '^27' cargo-mutants

PART := 0
MUTANTS := --shard $(PART)/24
mutants: setup $(CARGO_MUTANTS)
	CARGO_TARGET_DIR=$(abspath $(BUILT)) CARGO_PROFILE_DEV_OPT_LEVEL=0 $(CARGO_MUTANTS) mutants --output target $(MUTANTS)

# Search for bytes that break a reader, guided by coverage: libFuzzer on stable Rust, one target after the other for SECONDS
# each. Findings are written to target/fuzz/found; inputs with new coverage are kept in target/fuzz/corpus. All crates are built
# with counters, in a separate folder: the first build takes about ten minutes.
SECONDS := 60
FUZZ_TARGETS := framer wire channel session request recipe cell lens mounts pcd ply mesh clip picture pose tape zivid_settings krl backup worker labels tool office sparkplug
FUZZ_HOST := $(shell rustc -vV 2>/dev/null | sed -n 's/^host: //p')
FUZZ := target/fuzz/$(FUZZ_HOST)/fuzz/examples/fuzz
FUZZ_FLAGS := --cfg fuzzing -Cpasses=sancov-module $(addprefix -Cllvm-args=-sanitizer-coverage-,level=4 inline-8bit-counters pc-table trace-compares)
.PHONY: fuzz-build $(addprefix fuzz-,$(FUZZ_TARGETS))

fuzz-build: setup
	RUSTFLAGS='$(FUZZ_FLAGS)' cargo build --locked --profile fuzz --target $(FUZZ_HOST) --target-dir target/fuzz --no-default-features \
	  --features fuzz --example fuzz

fuzz: $(addprefix fuzz-,$(FUZZ_TARGETS))

# At most one second and 256 MB for each execution. The seeds are written before the search begins.
$(addprefix fuzz-,$(FUZZ_TARGETS)): fuzz-%: fuzz-build
	mkdir -p target/fuzz/corpus/$* target/fuzz/seeds/$* target/fuzz/found fixtures/fuzz/$*
	FUZZ_TARGET=$* FUZZ_SEEDS=target/fuzz/seeds/$* $(FUZZ) -max_total_time=$(SECONDS) -timeout=1 -rss_limit_mb=256 -max_len=65536 \
	  -artifact_prefix=target/fuzz/found/$*- -print_final_stats=1 target/fuzz/corpus/$* target/fuzz/seeds/$* fixtures/fuzz/$* \
	  >target/fuzz/$*.log 2>&1 || { tail -40 target/fuzz/$*.log; exit 1; }
	@echo "$* $$(sed -n 's/^stat::number_of_executed_units: */executions /p;s/^stat::average_exec_per_sec: */a second /p;s/^stat::peak_rss_mb: */MB /p' \
	  target/fuzz/$*.log | tr '\n' ' ') $$(grep -o 'cov: [0-9]*' target/fuzz/$*.log | tail -1)"

# Lines of Rust code by crate, without blank lines, comments and tests: today and at each of COMMITS.
COMMITS := f43e28f7
code-lines:
	@tests/code_lines.py $(COMMITS)

# A Debian package of the release build, in target/package/. Build it on the system on which it will be installed: Ubuntu 24.04 for a cell
# (the Zivid SDK has packages for Ubuntu only, Aravis 0.8.25 and newer are in Ubuntu from 24.04 on), Debian 12 for the simulated cell.
# It contains the camera library if `make zivid` was run before.
BUILT := $(or $(CARGO_TARGET_DIR),target)
CARGO_DEB := target/tools/bin/cargo-deb
DEB := $(CARGO_DEB) --no-build --output target/package/

$(CARGO_DEB):
	cargo install --locked --quiet --root target/tools --target-dir $(BUILT)/cargo-deb --version '^3' cargo-deb

package: setup $(CARGO_DEB)
	cargo build --release --locked --features plant
	rm -rf target/package
	$(BUILT)/release/panelprep package-files --out target/package >/dev/null
	cargo run --release --locked --features plant --quiet --example licences >target/package/licences.txt
	$(DEB) $(if $(wildcard target/zivid/libpanelprep_zivid.so),--variant zivid)

# Needs root. The former package is the same program under a former version.
package-test: package
	mkdir -p target/package/former
	$(CARGO_DEB) --no-build --deb-version 0.0.1-1 --output target/package/former/
	tests/package/install.sh target/package/former/*.deb target/package/*.deb

# The camera library over the Zivid SDK. Build it on the cell's computer with the installed SDK. Install the result in a folder of the
# loader (/usr/local/lib, then ldconfig), or name it in the cell's file, [scanner] library.
ZIVID := src/devices/zivid/cpp
ZIVID_BUILD = $(CXX) -std=c++17 -O2 -Wall -Wextra -shared -fPIC
ZIVID_LIBS := -lZividCore
zivid:
	mkdir -p target/zivid
	$(ZIVID_BUILD) $(ZIVID_FLAGS) $(ZIVID)/panelprep_zivid.cpp $(ZIVID_LIBS) -o target/zivid/libpanelprep_zivid.so

# The same text with declarations of the SDK's calls and a simulated camera; the tests build it themselves.
ZIVID_STUB := target/zivid-stub/libpanelprep_zivid.so
zivid-stub: $(ZIVID_STUB)
$(ZIVID_STUB): $(shell find $(ZIVID) -name '*.h' -o -name '*.cpp')
	mkdir -p $(@D)
	$(ZIVID_BUILD) -Werror -I$(ZIVID)/stub $(ZIVID)/panelprep_zivid.cpp $(ZIVID)/stub/play.cpp -o $@.new
	mv $@.new $@

# The benches add their figures to this file, whose name is the measured commit; make bench-table writes them into the table of
# tests/bench/README.md, and never those of another commit. That page itself is no change of what is measured.
BENCH_CHANGES = $(shell git diff --quiet HEAD -- . ':!tests/bench/README.md' 2>/dev/null || echo ' with changes')
GOALS = $(abspath $(BUILT))/goals/$(shell git rev-parse --short HEAD)$(BENCH_CHANGES).txt
bench bench-%: export GOALS := $(GOALS)

# A part that misses a goal, or cannot run, does not keep the others from running; the table is written after each part.
BENCHES := bench-seeds bench-robots bench-locate bench-inspect bench-damage bench-link bench-calib bench-wrong-inputs bench-surface bench-nominal bench-worker bench-cameras bench-recording bench-manual bench-world bench-history bench-removal bench-tool-faults bench-treat bench-office
bench: setup
	@failed=''; for part in $(BENCHES); do \
	  $(MAKE) -k $$part || failed="$$failed $$part"; \
	  $(MAKE) bench-table || failed="$$failed $$part:bench-table"; \
	done; \
	test -z "$$failed" || { echo "These parts missed a goal or did not run:$$failed" >&2; exit 1; }

bench-table:
	@cargo bench --locked --quiet --bench table

# Every command of the manual, from the package to a cell in daily work, over the devices' real interfaces and in real time.
bench-manual: setup
	cargo test --locked --test all -- --ignored --nocapture the_manual_leads

# Ten seeds through the live cycle, against the simulator's truth.
bench-seeds: setup
	cargo bench --locked --bench seeds

# Cycles with arms that deviate 0.02, 0.1, 0.5 and 1.6 mm from their drawing, calibrated and not.
bench-robots: setup
	cargo bench --locked --bench robots

# The water-break test: hard films, damaged clips, speed compared with the thesis's pipeline in a separate Python environment under target/.
OPENCV_PEER := target/bench-inspect
bench-inspect: setup
	@test -x $(OPENCV_PEER)/bin/python || { \
	  python3 -m venv $(OPENCV_PEER) && $(OPENCV_PEER)/bin/pip install --quiet 'opencv-python-headless>=4.5' numpy; } || { \
	  rm -rf $(OPENCV_PEER); echo 'Python OpenCV cannot be set up; the bench runs without it.' >&2; }
	if test -x $(OPENCV_PEER)/bin/python; then export PANELPREP_PEERS=$(CURDIR)/$(OPENCV_PEER)/bin/python; fi; \
	  cargo bench --locked --bench inspect

# 10,000 damaged scans, corner pictures and clips: none may turn a broken film into a pass or move a pose unnoticed. Fewer:
# make bench-damage DAMAGED='scans=400 pictures=400 clips=200'.
DAMAGED :=
bench-damage: setup
	cargo bench --locked --bench damage -- $(DAMAGED)

# The 3D camera's worker, with the simulated camera: a full-size shot through its socket, two hundred kills. Five minutes.
bench-worker: setup zivid-stub
	cargo bench --locked --bench worker

# The robot link: rates, time from a lost acknowledgement to STOP, long paths: about five minutes. Then 200,000 walks over the
# controller's programs: more than an hour on two idle cores; fewer: cargo bench --locked --bench link -- programs 5000
.PHONY: bench-link-walks bench-link-rates
bench-link: bench-link-walks bench-link-rates

bench-link-walks: setup
	LINK_WALKS=20000 cargo test --locked --test all -- no_walk_violates_a_requirement

bench-link-rates: setup
	cargo bench --locked --bench link

# The search over ten thousand cycles: every kind of query within 100 ms at its 95th percentile.
bench-history: setup
	cargo bench --locked --bench history

# Needs nats-server and PostgreSQL of Debian; without them it reports that it did not run. About 30 minutes.
bench-office: setup
	cargo bench --locked --features plant --bench office

# One simulation of the whole system, with faults of every kind at every moment: `WORLDS` seeds in one thread. To repeat one seed:
# cargo bench --locked --bench world -- seed=N, or seed=N script='[…]' as a failing one prints it. Then `KILLS` processes that are killed.
WORLDS := 20000
KILLS := 10000
.PHONY: bench-world-seeds bench-world-kills
bench-world: bench-world-seeds bench-world-kills

bench-world-seeds: setup
	RAYON_NUM_THREADS=1 cargo bench --locked --bench world -- seeds=$(WORLDS)

bench-world-kills: setup
	RAYON_NUM_THREADS=1 cargo bench --locked --bench world -- kills=$(KILLS)

# A service with page, clients and recordings for two hours by the wall clock, so it is not in `bench`; a shorter run:
# make bench-soak SOAK='minutes=10 report_s=30'.
SOAK :=
bench-soak: setup
	cargo bench --locked --bench soak -- $(SOAK)

# Whole cycles by the wall clock over a cable that corrupts its data, in as many parallel cells as CABLE states. Only one scenario:
# make bench-cable CABLE='only=14 cells=1 keep=/tmp'. Each cell computes little, but late threads end cycles: run no other bench meanwhile.
CABLE :=
bench-cable: setup
	cargo bench --locked --bench cable -- $(CABLE)

# Changes of the product's sources, each built and run until a world finds it. Not part of `make bench`: two minutes or more for each
# change, three hours for all on two idle cores. Only some: make bench-mutations MUTATED='only=epoch seeds=10000 limit_s=1800'.
MUTATED :=
bench-mutations: setup
	cargo bench --locked --profile dev --bench mutations -- $(MUTATED)

# Ten minutes of full-size pictures over GigE Vision loopback, each compared; a shorter run: make bench-cameras CAMERA_SECONDS=60.
CAMERA_SECONDS := 600
bench-cameras: setup
	cargo bench --locked --bench cameras -- $(CAMERA_SECONDS)

OPENCV_DOC := target/opencv-doc/usr/share/doc/opencv-doc/examples/data/left01.jpg

# A real camera's pictures, from Debian's opencv-doc; unpacked in target/, nothing is installed.
$(OPENCV_DOC):
	mkdir -p target/opencv-doc
	cd target/opencv-doc && apt-get download opencv-doc && dpkg -x opencv-doc_*.deb . && rm opencv-doc_*.deb

# Calibrations of wrong inputs: every mistake, WRONG_SEEDS seeds, both mounts. None is accepted, each is named.
WRONG_SEEDS := 20
bench-wrong-inputs: setup
	cargo bench --locked --bench wrong_inputs -- seeds=$(WRONG_SEEDS)

# Calibrations compared with the renderer's truth and on a real camera's pictures, simulated arms, and boards in poor pictures compared with
# OpenCV's detectors; only the last two: cargo bench --bench arms, cargo bench --bench boards.
.PHONY: bench-calib-tests bench-calib-mounts bench-calib-arms bench-calib-boards
bench-calib: bench-calib-tests bench-calib-mounts bench-calib-arms bench-calib-boards

bench-calib-tests: setup
	@$(MAKE) $(OPENCV_DOC) || echo 'opencv-doc could not be fetched; its pictures are skipped' >&2
	cargo test --locked --test all -- --nocapture real_pictures a_bent_scanner_is_straightened

bench-calib-mounts: setup
	cargo bench --locked --bench calib

bench-calib-arms: setup
	cargo bench --locked --bench arms

bench-calib-boards: setup
	cargo bench --locked --bench boards

# Public pictures of real boards and robots: opencv-doc, and a copy of ros-industrial/industrial_calibration (Apache-2.0) by
# REAL=FOLDER. A missing set is reported as not run, and the bench does not pass.
bench-real: setup
	@$(MAKE) $(OPENCV_DOC) || echo 'opencv-doc could not be fetched; its pictures are not run' >&2
	REAL='$(REAL)' cargo bench --locked --bench real

# The surface and the paths over it, compared with geomdl and scipy in a separate Python environment under target/; only some parts:
# make bench-surface PARTS='fit 5', of fit [SEEDS], evaluate, paths, patterns [SEEDS up to 10], attitudes, gauntlet.
PARTS :=
PEERS := target/bench-surface
bench-surface: setup
	@test -x $(PEERS)/bin/python || { \
	  python3 -m venv $(PEERS) && $(PEERS)/bin/pip install --quiet 'geomdl==5.4.0' 'scipy>=1.11'; } || { \
	  rm -rf $(PEERS); echo 'The Python peers cannot be set up; the bench runs without them.' >&2; }
	if test -x $(PEERS)/bin/python; then export PANELPREP_PEERS=$(CURDIR)/$(PEERS)/bin/python; fi; \
	  cargo bench --locked --bench surface -- $(PARTS)

# Bent panels compared with their drawing, beside a plain point-to-mesh distance, and Open3D if the environment of bench-locate-peers
# exists; other panels: make bench-nominal BENT=41-60.
BENT := 1-20
bench-nominal: setup
	if test -x $(MATCHERS)/bin/python; then export PANELPREP_PEERS=$(CURDIR)/$(MATCHERS)/bin/python; fi; \
	  cargo bench --locked --bench nominal -- $(BENT)

# A compliant tool that fails at places along the whole path: time until the sander is off; at every waypoint: EVERY=1.
EVERY := 12
bench-tool-faults: setup
	cargo bench --locked --bench tool_faults -- $(EVERY)

# Paths over areas around breaks, beside whole grids, planned and in whole cycles; fewer: make bench-treat TREATED='seeds=6'.
TREATED := seeds=60 reduction=4 minutes=15
bench-treat: setup
	cargo bench --locked --bench treat -- $(TREATED)

# The removal by the disc, compared with mr-sim in a separate Python environment under target/; only some parts: make bench-removal
# PARTS='panels', of peers, finer, panels, speed, published.
REMOVERS := target/bench-removal
bench-removal: setup
	@test -x $(REMOVERS)/bin/python || { \
	  python3 -m venv $(REMOVERS) && $(REMOVERS)/bin/pip install --quiet 'mr-sim==1.0.1' numpy scipy matplotlib; } || { \
	  rm -rf $(REMOVERS); echo 'The Python package mr-sim cannot be set up; the bench runs without it.' >&2; }
	if test -x $(REMOVERS)/bin/python; then export PANELPREP_PEERS=$(CURDIR)/$(REMOVERS)/bin/python; fi; \
	  cargo bench --locked --bench removal -- $(PARTS)

# Localization in three parts, each well below an hour on two cores; the last with third-party Python packages in a venv.
MATCHERS := target/bench-locate
.PHONY: bench-locate bench-locate-good bench-locate-bad bench-locate-identify bench-locate-peers
bench-locate: bench-locate-good bench-locate-bad bench-locate-identify bench-locate-peers

bench-locate-good: setup
	cargo bench --locked --bench locate -- good bows memory

bench-locate-bad: setup
	cargo bench --locked --bench locate -- bad wet

bench-locate-identify: setup
	cargo bench --locked --bench locate -- identify

bench-locate-peers: setup
	@test -x $(MATCHERS)/bin/python || { \
	  python3 -m venv $(MATCHERS) && \
	  $(MATCHERS)/bin/pip install --quiet 'open3d==0.20.0' 'small_gicp==1.0.1' 'kiss-matcher==1.0.2'; } || { \
	  rm -rf $(MATCHERS); echo 'The Python peers cannot be set up; the bench runs without them.' >&2; }
	if test -x $(MATCHERS)/bin/python; then export PANELPREP_PEERS=$(CURDIR)/$(MATCHERS)/bin/python; fi; \
	  cargo bench --locked --bench locate -- peers

# Recordings read with the public mcap package in a separate Python environment under target/.
READERS := target/bench-recording
bench-recording:
	@test -x $(READERS)/bin/python || { \
	  python3 -m venv $(READERS) && $(READERS)/bin/pip install --quiet 'mcap>=1.2' 'mcap-protobuf-support>=0.5'; } || { \
	  rm -rf $(READERS); echo 'The Python package mcap cannot be set up.' >&2; exit 1; }
	$(READERS)/bin/python tests/bench/recording_peers.py fixtures/*.mcap

# The cycles in fixtures/, recorded again: a seventh of the pixels in each direction, two pictures of the film in a second.
RECORDED := target/fixtures
fixtures: setup
	cargo build --locked --features plant
	rm -rf $(RECORDED)
	$(call record,good,cycle)
	$(call record,wrong-panel,rejected)

define record
	target/debug/panelprep render --scene $(1) --reduction 7 --seconds 20 --out $(RECORDED)/$(2)
	sed -i 's/^frames_per_second = .*/frames_per_second = 2.0/' $(RECORDED)/$(2)/recipe.toml
	target/debug/panelprep teach --cell $(RECORDED)/$(2)/cell.toml --recipe $(RECORDED)/$(2)/recipe.toml \
	  --scan $(RECORDED)/$(2)/taught_scan.pcd --corner $(RECORDED)/$(2)/taught_corner.png \
	  --flange $(RECORDED)/$(2)/taught_flange.json
	target/debug/panelprep calibrate verify --cell $(RECORDED)/$(2)/cell.toml --camera scanner --board 5x4 \
	  --square-mm 40 --target $(RECORDED)/$(2)/target/scanner.toml --image $(RECORDED)/$(2)/target/scanner.png
	target/debug/panelprep calibrate verify --cell $(RECORDED)/$(2)/cell.toml --camera flange-camera --board 5x4 \
	  --square-mm 40 --target $(RECORDED)/$(2)/target/flange_camera.toml \
	  --image $(RECORDED)/$(2)/target/flange_camera.png --flange $(RECORDED)/$(2)/target/flange.json
	rm -f fixtures/$(2).mcap
	target/debug/panelprep cycle --cell $(RECORDED)/$(2)/cell.toml --recipe $(RECORDED)/$(2)/recipe.toml \
	  --scene $(1) --record fixtures/$(2).mcap || test $$? = 1
	target/debug/panelprep replay fixtures/$(2).mcap
endef
