#!/bin/sh
# The first grasp over vcan0: modules and scene in one process, the controller in another, candump beside them.
# Usage: first_grasp.sh DIRECTORY RATE_HZ PACE: on the wire there are RATE_HZ x PACE commands a second
set -eu
cd "$1"
export TMPDIR=/dev/shm
candump -L vcan0 > can.log &
listening=$!
preshape hand-bus --interface socketcan --channel vcan0 --pace "$3" --patience-cycles 50 --seed 0 \
    > hand_bus.txt 2>&1 &
modules=$!
until grep -q ready hand_bus.txt; do
    kill -0 "$modules" || { cat hand_bus.txt; exit 1; }
    sleep 0.2
done
status=0
preshape run --device can --attach --interface socketcan --channel vcan0 --rate-hz "$2" --patience-cycles 50 \
    --until-task 1 --seed 0 --no-record --no-pictures --out out || status=$?
kill -INT "$modules" 2>/dev/null || true
wait "$modules" || true
cat hand_bus.txt
kill "$listening"
exit "$status"
