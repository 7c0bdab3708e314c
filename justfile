# Recipes of the project. `just ci` is what CI runs.

default:
    @just --list

# Runs a scenario (default: floor) in realtime.
run *ARGS:
    cargo run --release -- {{ARGS}}

# Runs all tests on the release build.
test:
    cargo test --release --workspace

# Explores the interleavings of libs/sync with loom.
loom:
    RUSTFLAGS="--cfg loom" CARGO_TARGET_DIR=target/loom cargo test --release -p hapfic-sync

# Checks format, prose, clippy, docs, tests and loom.
ci:
    .ci/run

# Writes the tables of docs/experiments.md and README (some minutes); fails if the defaults miss their targets.
experiments:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin experiments -- docs/experiments.md README.md

# Writes the tables of docs/walls.md: the held force on walls of every stiffness and damping (some minutes).
walls:
    cargo run --release -q -p hapfic-tests --bin walls -- docs/walls.md

# Draws the figures of docs/paper-experiments.md and docs/robots.md from lockstep runs (about a minute).
figures:
    #!/usr/bin/env bash
    set -euo pipefail
    mkdir -p docs/figures logs
    for name in floor box ball ball-actuators arm-press arm-scan; do
        cargo run --release -q -- run "$name" --clock lockstep --log "logs/$name.mcap"
        cargo run --release -q -- report "logs/$name.mcap" --png "logs/$name"
        cp "logs/$name/overview.png" "docs/figures/$name.png"
    done

# Simulates random leg motion among box and ball, 100 seeds of 10 s each (some ten minutes), and prints the results.
seeds:
    HAPFIC_SEEDS=100 cargo test --release -p hapfic-simulation --test simulation -- leg_motion --nocapture

# Fuzzes every decoder of outside data, SECONDS each; fails on a panic, a hang or too much memory.
fuzz SECONDS="60":
    cargo run --release -q -p hapfic-tests --bin fuzz -- all --seconds {{SECONDS}}

# Injects faults into the real stack and writes the tables of docs/faults.md (about an hour; --quick: a quarter).
faults *ARGS:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin faults -- docs/faults.md {{ARGS}}

# Kills processes a thousand times and halts them two hundred times in ten minutes; writes docs/faults.md.
soak MINUTES="10":
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin faults -- docs/faults.md --only soak --minutes {{MINUTES}}

# Checks whether this machine is good enough for 1 kHz.
doctor *ARGS:
    cargo run --release -q -- doctor {{ARGS}}

# Measures the stack's chain hop by hop, beside the machine's floor and peers (zenoh, ZeroMQ, iceoryx2's events).
latency *ARGS:
    cargo build --release
    cd bench && cargo build --release -p hapfic-peers
    cargo run --release -q -- bench latency --peers bench/target/release/hapfic-peers {{ARGS}}

# Runs the benchmarks of bench/ (some minutes); bench/README.md describes them.
bench *ARGS:
    cd bench && cargo bench -p hapfic-bench-micro -p hapfic-bench-control -- {{ARGS}}

# Measures legs per machine and simulation speed; writes docs/performance.md (some minutes).
scale *ARGS:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin scale -- docs/performance.md {{ARGS}}

# Compares the plant's sub-step with MuJoCo's (needs a Python with bench/mujoco/requirements.txt).
mujoco *ARGS:
    cd bench && cargo build --release -p hapfic-bench-substep
    python3 bench/mujoco/compare.py {{ARGS}}

# Prints the JSON Schema of scenario files.
schema:
    cargo run --release -q -- schema
