"""Run the shell commands of README, guides and tutorials, in the order in which they stand.

    .venv/bin/python tools/docs/run_guides.py [PAGE ...] [--first] [--folder FOLDER] [--limit 60]

With ``--first`` all commands of README run, and the first of each other page. They run in one
empty folder that has links to what a checkout contains, in the state that `make setup` leaves.
`STAND_INS` names the files of readers that pages speak of, `CHANGES` shortens
commands, and `SKIPPED` says why some do not run. The output of each command is kept in the folder's
`log/`. The exit status is 1 if a command failed that should not, or the other way round.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    "README.md",
    *(
        f"docs/guide/{name}.md"
        for name in (
            "install",
            "first_user",
            "train",
            "gpu",
            "evaluate",
            "study",
            "report",
            "audit",
            "look",
            "own_game",
            "own_page",
            "own_program",
            "own_body",
        )
    ),
    "docs/reference/sessions.md",
    *(f"docs/tutorials/{name}.md" for name in ("web_developer", "unity_developer", "rl_engineer")),
)

TASK = """seconds: 5
devices: [controller_right]
inputs: [right.trigger]
reward:
  - {haptics: right, weight: 1}
"""
SHOP = """targets:
  - {name: pay, place: [0.2, 1.1, 0.45], how: press, radius_m: 0.02}
  - {name: sign, place: [0, 1.6, 4], how: look}
"""
# Head and right hand of a person at 60 Hz, 20 s, right-handed axes, y up.
PERSON = """import csv, math

parts = ("x", "y", "z", "qx", "qy", "qz", "qw")
with open("person.csv", "w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["time_s", *(f"{one}_{part}" for one in ("head", "right") for part in parts)])
    for k in range(1200):
        t = k / 60
        hand = [0.15 + 0.1 * math.sin(2 * t), 1 + 0.1 * math.cos(3 * t), -0.4, 0, 0, 0, 1]
        table.writerow([t, 0, 1.2, 0, 0, 0, 0, 1, *hand])
"""
WEBXR = "docs/examples/webxr"
# Before a page: shell commands that make the reader's own files of which it speaks.
STAND_INS = {
    "docs/guide/train.md": f"cp {WEBXR}/drawer/index.html page.html; cp {WEBXR}/drawer/task.yaml .",
    "docs/guide/audit.md": f"cp {WEBXR}/keypad/index.html shop.html; cp shop.targets shop.yaml",
    "docs/guide/own_page.md": f"cp {WEBXR}/drawer/index.html game.html; "
    f"cp {WEBXR}/drawer/task.yaml task.yaml",
    "docs/guide/own_program.md": "cp program.task task.yaml",
    "docs/reference/sessions.md": "python person.py && sim2vr-harness session convert person.csv "
    f"recording.json; cp {WEBXR}/drawer/index.html game.html; cp {WEBXR}/drawer/task.yaml .; "
    "ln -sf /bin/true game",
}
ENGINES = f"--map https://cdn.jsdelivr.net/npm/={WEBXR}/engines"
ROUND = "--set env.app.options.round_seconds=3"
SHORT = (
    "--set recipe=ppo --set total_timesteps=128 --set ppo.n_envs=4 --set ppo.n_steps=32 "
    "--set ppo.batch_size=64 --set evaluation.episodes_after_training=0"
)
# (text in a command, what replaces it): the reader's own things, and shorter work.
CHANGES = (
    ("study --page game.html", "study --page docs/examples/webxr/menu " + ENGINES),
    ("--openxr ./game", "--openxr 'hello_xr -g Vulkan2'"),
    ("--page game.html", f"--page game.html {ENGINES}"),
    ("--page page.html", f"--page page.html {ENGINES}"),
    ("--page shop.html", f"--page shop.html {ENGINES}"),
    ("MAP=https", f"MAP=https://cdn.jsdelivr.net/npm/={WEBXR}/engines #"),
    ("\nseconds: 20\n", "\nseconds: 3\n"),
    ("\npeople: 12 ", "\npeople: 3 "),
    ("--vary button_m=0.04,0.08,0.16", f"--vary button_m=0.04,0.16 --people 2 {ROUND}"),
    (
        "--vary size=0.04,0.06,0.08 --vary height=1.0,1.4 --people 24",
        "--vary size=0.04,0.08 --people 2",
    ),
    ("--vary size=0.04,0.08 --people 24", "--vary size=0.04,0.08 --people 2"),
    ("--vary button_m=0.04,0.08 --people 24", f"--vary button_m=0.04,0.08 --people 2 {ROUND}"),
    ("\nepisodes: 3 ", "\nepisodes: 1 "),
    ("\nfactors:", "\n  env.app.options.round_seconds: 5\nfactors:"),
    ("page vendor game.html", "page vendor game.html --yes"),
    ("--people 500", "--people 30"),
    ("--operate 30", "--people 30 --operate 2"),
    ("--out runs/sample", "--out runs/sample --overwrite"),  # the README made it, too
    ("--people 12 #", "--people 12 --condition medium #"),
    ("--people 12 --episodes", "--people 12 --condition medium --episodes"),
    ("--people 12", f"--people 2 {ROUND}"),
    ("audit --game whacamole", "audit --game whacamole --people 10"),
    ("--targets shop.yaml --expect", "--targets shop.yaml --people 10 --expect"),
    ("--episodes 20", "--episodes 2"),
    ("--episodes 8", f"--episodes 1 {ROUND}"),
    ("--episodes 10", f"--episodes 2 {ROUND}"),
    ("--episodes 5", "--episodes 1"),
    ("pretrained:whacamole_constrained --", f"pretrained:whacamole_constrained {ROUND} --"),
    ("--set total_timesteps=61440", "--set total_timesteps=4096"),
    ("--episodes 2 --set env.app.options.round", "--episodes 1 --set env.app.options.round"),
    ("--steps 20000", "--steps 2048"),
    ("train sample", f"train sample {SHORT}"),
    ("train --page page.html", f"train --page page.html {SHORT}"),
    ("train --page game.html", f"train --page game.html {SHORT}"),
    ("train mygame", f"train mygame {SHORT}"),
    ("train --page catch", f"train --page catch {SHORT}"),
)
# (text in a command, reason): the first that matches.
SKIPPED = (
    ("make ", "installs and builds: the state in which this script starts"),
    ("apt-get", "installs: the state in which this script starts"),
    ("git clone", "the checkout is there"),
    ("docker ", "CI builds the image"),
    ("pip install", "wheels have their own tests"),
    ("ray start", "needs several machines"),
    ("--ray ", "needs several machines"),
    ("train_with_rllib", "needs ray[rllib], which is not installed"),
    ("whac-a-mole.x86_64", "needs the Unity build"),
    ("mygame.x86_64", "needs a Unity build"),
    ("runs/mygame", "needs a Unity build, or a trained user of a game of one's own"),
    ("mygame", "needs a C++ game of one's own"),
    ("--connect", "needs a server"),
    ("--port", "serves until it is stopped"),
    ("session record", "serves until it is stopped"),
    ("runs/my_page", "needs a trained user of the reader's own"),
    ("harness watch", "serves until it is stopped"),
    ("mujoco.viewer", "needs a display"),
    ("paper_whacamole", "plays for an hour"),
    ("whacamole_constrained_distill", "a whole training"),
    ("train --openxr", "a whole training; hello_xr earns nothing"),
    ("train --resume", "resumes the training above"),
    ("runs/mine", "needs the training above"),
    ("evaluate runs/game --record --out out/game", "needs the training above"),
    ("report out/game", "needs the training above"),
    ("round.json", "needs a session of the reader's own"),
    ("runs/mybody", "trains the body's motor policy first"),
)
# (page, text): commands that have to fail, because the page shows how a check fails.
FAILING = (
    ("docs/guide/evaluate.md", "big:distance_m < 0.1"),
    ("docs/guide/own_page.md", "# addresses, engine, objects"),
)

BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^ *```", flags=re.S | re.M)


def commands(text: str) -> list[str]:
    """Shell commands in fenced blocks, and YAML files that a page says to save, in their order."""
    found = []
    for match in BLOCK.finditer(text):
        language, body = match[2], match[3]
        if language == "yaml":
            named = re.match(r"# (\S+\.yaml)\n", body)
            saved = re.search(r"Save this as `([^`]+)`:\s*$", text[: match.start()])
            if name := (saved or named):
                found.append(f"cat > {name[1]} <<'END'\n{body}END")
        if language != "sh":
            continue
        part = ""
        for line in body.splitlines():
            part += line.removeprefix(match[1]) + "\n"
            loop = len(re.findall(r"^\s*for\b", part, re.M)) > len(re.findall(r"\bdone\b", part))
            if not line.endswith("\\") and not loop:
                if part.strip() and not part.lstrip().startswith("#"):
                    found.append(part.strip())
                part = ""
    return found


def skipped(command: str) -> str | None:
    """Why a command is not run; None: it is."""
    for text, reason in SKIPPED:
        if text in command:
            return reason
    return None


def with_path() -> dict[str, str]:
    """Return the environment of a shell in which .venv is active."""
    return {**os.environ, "PATH": f"{ROOT / '.venv/bin'}:{os.environ['PATH']}"}


def run(command: str, before: str, folder: Path, log: Path, limit_s: float) -> tuple[int, float]:
    """Run a shell command; return its exit status (124: too long) and its seconds."""
    started = time.monotonic()
    script = f"{before}\n{command}"
    with log.open("w", encoding="utf-8") as file:
        file.write(f"$ {command}\n")
        file.flush()
        process = subprocess.Popen(
            ["bash", "-e", "-c", script],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=with_path(),
            start_new_session=True,
        )
        try:
            status = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            status = 124
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
    return status, time.monotonic() - started


def last_line(log: Path) -> str:
    """Return the last line of a command's output."""
    lines = [line.strip() for line in log.read_text(encoding="utf-8").splitlines() if line.strip()]
    return lines[-1] if len(lines) > 1 else ""


def prepare(folder: Path) -> None:
    """Put links to the checkout and the stand-ins' texts into an empty folder."""
    (folder / "log").mkdir(parents=True)
    for name in ("docs", "configs", "tools", "build", ".venv"):
        (folder / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / "studies", folder / "studies")  # commands write there
    subprocess.run(["sh", ROOT / WEBXR / "engines.sh"], check=True, stdout=subprocess.DEVNULL)
    (folder / "shop.targets").write_text(SHOP)
    (folder / "program.task").write_text(TASK)
    (folder / "person.py").write_text(PERSON)


def main() -> int:
    """Run the pages' commands and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("pages", nargs="*", default=[])
    parser.add_argument("--first", action="store_true", help="of other pages than README")
    parser.add_argument("--folder", type=Path, help="an empty one; default: a temporary one")
    parser.add_argument("--limit", type=float, default=60, help="seconds for a command")
    options = parser.parse_args()
    folder = Path(options.folder or tempfile.mkdtemp(prefix="sim2vr_guides_")).resolve()
    prepare(folder)
    bad = 0
    counts = []
    print(f"{'page':<24}{'rc':>4}{'s':>7}  command -> last line of its output")
    for page in PAGES:
        if options.pages and not any(page.endswith(name) for name in options.pages):
            continue
        count = {"run": 0, "ok": 0, "differ": 0, "skipped": 0}
        before = STAND_INS.get(page, "")
        if before:
            subprocess.run(["bash", "-c", before], cwd=folder, check=True, env=with_path())
        before = ""
        for number, command in enumerate(commands((ROOT / page).read_text(encoding="utf-8")), 1):
            shown = " ".join(command.split("\n")[0].split())
            name = page.removeprefix("docs/")
            if reason := skipped(command):
                count["skipped"] += 1
                print(f"{name:<24}{'-':>4}{'-':>7}  {shown} -> skipped: {reason}", flush=True)
                continue
            for old, new in CHANGES:
                command = command.replace(old, new)
            if re.match(r"(export \w+|\w+)=\S*( #.*)?$", command):
                before += command + "\n"  # holds for the page's later commands
                continue
            if options.first and page != "README.md" and count["run"]:
                break
            log = folder / "log" / f"{Path(page).stem}_{number:02}.txt"
            status, seconds = run(command, before, folder, log, options.limit)
            fails = any(page == where and text in command for where, text in FAILING)
            fine = (status == 1) if fails else (status == 0)
            bad += not fine
            count["run"] += not command.startswith("cat > ")
            count["ok" if fine else "differ"] += 1
            mark = "" if fine else "  <-- FAILED"
            print(
                f"{name:<24}{status:>4}{seconds:>7.1f}  {shown} -> {last_line(log)[:110]}{mark}",
                flush=True,
            )
        counts.append((page, count))
    print()
    for page, count in counts:
        print(f"{page:<32}" + ", ".join(f"{value} {key}" for key, value in count.items()))
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
