# What one can do here. `just ci` is what CI runs.

default:
    @just --list

# The main job: the floor scenario in realtime.
run *ARGS:
    cargo run --release -- {{ARGS}}

# All tests, on the release build.
test:
    cargo test --release --workspace

# Format check, clippy, docs, tests.
ci:
    .ci/run

# The tables of docs/experiments.md, written into it (some minutes); fails if the defaults fall short.
experiments:
    cargo build --release --workspace
    cargo run --release -q -p hapfic-tests --bin experiments -- docs/experiments.md

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

# The JSON Schema of scenario files.
schema:
    cargo run --release -q -- schema
