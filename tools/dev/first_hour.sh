#!/usr/bin/env bash
# What a designer, a researcher and a developer of native programs do first, after `make setup`.
#   tools/dev/first_hour.sh [FOLDER]     FOLDER: an empty one; default: a new one below /tmp
# Each command is shown with its output, exit status and seconds. The exit status is 1 if one failed.
# It needs npm (engines of the page) and hello_xr (Debian: libopenxr-utils).
set -uo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
folder=${1:-$(mktemp -d)}
mkdir -p "$folder" && cd "$folder" || exit 1
PATH="$root/.venv/bin:$PATH"
failed=0

try() {
  local began=$SECONDS status=0
  printf '\n$ %s\n' "$*"
  "$@" </dev/null || status=$?
  printf '[exit status %d, %d s]\n' "$status" $((SECONDS - began))
  [[ $status == 0 ]] || failed=1
}

echo "== Designer: can people use my page?"
cp "$root/docs/examples/webxr/buttons/index.html" game.html
try sim2vr-harness doctor
try sim2vr-harness page vendor game.html --yes
try sim2vr-harness page check game.html --map engines/map.json
try sim2vr-harness render snapshot --page game.html --map engines/map.json --out pictures
try sim2vr-harness audit --page game.html --map engines/map.json --people 30 --out audit

echo; echo "== Researcher: which design is better, and do people agree?"
try sim2vr-harness evaluate --user random --set env.app.game=sample --condition usual --condition big \
  --episodes 2 --out played
cat > height.yaml <<'END'
name: height
title: Does a low board cost less effort than a high one?
fixed: {user: pretrained:whacamole_people, env.app.options.round_seconds: 5}
factors:
  height: {key: condition, levels: [low, high]}
people: 6
episodes: 1
measures: [effort, hit_rate]
comparisons: [{factor: height}]
END
try sim2vr-harness study height.yaml --plan
try sim2vr-harness study height.yaml --out height
python - <<'END'
# A person's recording as a table: head and right hand at 60 Hz, 20 s, right-handed axes, y up.
import csv, math

with open("person.csv", "w", newline="", encoding="utf-8") as file:
    table = csv.writer(file)
    table.writerow(["time_s"] + [f"{d}_{a}" for d in ("head", "right") for a in ("x", "y", "z", "qx", "qy", "qz", "qw")])
    for k in range(1200):
        t = k / 60
        table.writerow([t, 0, 1.2, 0, 0, 0, 0, 1, 0.15 + 0.1 * math.sin(2 * t), 1 + 0.1 * math.cos(3 * t), -0.4, 0, 0, 0, 1])
END
try sim2vr-harness session convert person.csv person.jsonl
try sim2vr-harness session show person.jsonl
printf '%s\n' 'seconds: 10' 'reward: [{seconds: true, weight: -0.1}]' > game_task.yaml
try sim2vr-harness compare 'touch low' --recordings person.csv --page game.html --map engines/map.json \
  --task game_task.yaml --episodes 1 --out people

echo; echo "== Developer of a native program: does it work without a headset?"
printf '%s\n' 'seconds: 5' 'devices: [controller_right]' 'reward: [{haptics: right}]' > task.yaml
try sim2vr-harness render snapshot --openxr "hello_xr -g Vulkan2" --out program
try sim2vr-harness evaluate --openxr "hello_xr -g Vulkan2" --task task.yaml --user random --episodes 1 --out program/random
try sim2vr-harness evaluate --openxr "hello_xr -g Vulkan2" --task task.yaml --user "press 0.2 1.1 0.4" --episodes 1 --out program/press
exit $failed
