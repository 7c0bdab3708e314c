# What one can do here. `just ci` is what CI runs.

default:
    @just --list

# The main job: the floor scenario in realtime.
run *ARGS:
    cargo run --release -- {{ARGS}}

# All tests, on the release build.
test:
    cargo test --release --workspace

# Every interleaving of the lock-free pieces.
loom:
    RUSTFLAGS="--cfg loom" CARGO_TARGET_DIR=target/loom cargo test --release -p hapfic-sync

# Format check, prose, clippy, docs, tests, loom.
ci:
    .ci/run

# The tables of docs/experiments.md and README, written into them (some minutes); fails if the defaults fall short.
experiments:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin experiments -- docs/experiments.md README.md

# The figures of README, from lockstep runs (about a minute).
figures:
    #!/usr/bin/env bash
    set -euo pipefail
    mkdir -p docs/figures logs
    for name in floor box ball ball-actuators; do
        cargo run --release -q -- run "$name" --clock lockstep --log "logs/$name.mcap"
        cargo run --release -q -- report "logs/$name.mcap" --png "logs/$name"
        cp "logs/$name/overview.png" "docs/figures/$name.png"
    done

# Random leg motion among box and ball, 100 seeds of 10 s each (some ten minutes), and what they came to.
seeds:
    HAPFIC_SEEDS=100 cargo test --release -p hapfic-simulation --test simulation -- leg_motion --nocapture

# Feeds every decoder of outside data with mutated inputs, SECONDS each; fails if one panics, hangs or takes too much memory.
fuzz SECONDS="60":
    cargo run --release -q -p hapfic-tests --bin fuzz -- all --seconds {{SECONDS}}

# The tables of docs/faults.md, written into it: faults on purpose in the real stack (about an hour; with --quick a quarter of it).
faults *ARGS:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin faults -- docs/faults.md {{ARGS}}

# A thousand kills and two hundred halts in ten minutes, into docs/faults.md.
soak MINUTES="10":
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin faults -- docs/faults.md --only soak --minutes {{MINUTES}}

# Is this machine good enough for 1 kHz?
doctor *ARGS:
    cargo run --release -q -- doctor {{ARGS}}

# The stack's chain hop by hop, beside the machine's floor and its peers (zenoh, ZeroMQ, iceoryx2's own events).
latency *ARGS:
    cargo build --release
    cd bench && cargo build --release -p hapfic-peers
    cargo run --release -q -- bench latency --peers bench/target/release/hapfic-peers {{ARGS}}

# The benchmarks of bench/ (some minutes); what each shows is in bench/README.md.
bench *ARGS:
    cd bench && cargo bench -p hapfic-bench-micro -p hapfic-bench-control -- {{ARGS}}

# How many legs this machine carries, and how fast it simulates, into docs/performance.md (some minutes).
scale *ARGS:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin scale -- docs/performance.md {{ARGS}}

# The plant's sub-step beside MuJoCo's (needs a Python with bench/mujoco/requirements.txt).
mujoco *ARGS:
    cd bench && cargo build --release -p hapfic-bench-substep
    python3 bench/mujoco/compare.py {{ARGS}}

# The JSON Schema of scenario files.
schema:
    cargo run --release -q -- schema
