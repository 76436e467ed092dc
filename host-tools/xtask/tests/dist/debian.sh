#!/bin/sh
# Runs in a fresh Debian without Rust, as root: installs the package and the wheel that lie beside this
# script, and uses both. The last line says that all of it worked.
set -eu
cd "$(dirname "$0")"

if command -v cargo || command -v rustc; then
    echo "there is a Rust here"
    exit 1
fi
apt-get install --yes --no-install-recommends ./plumb_*.deb
plumb --version
ldd /usr/bin/plumb

echo "== pages for man and completions"
export MANPAGER=cat MANWIDTH=300
man plumb | grep -q "one camera and two printed targets"
man plumb-receive | grep -q -- --duration
bash -c '
    . /usr/share/bash-completion/bash_completion
    . /usr/share/bash-completion/completions/plumb
    COMP_WORDS=(plumb cal) COMP_CWORD=1
    _plumb plumb cal plumb
    echo "bash completes cal to: ${COMPREPLY[*]}"
    test "${COMPREPLY[*]}" = calibrate'
zsh -c 'autoload -U compinit && compinit -u && whence -w _plumb && test "${_comps[plumb]}" = _plumb'
fish -c 'complete --do-complete "plumb cal"' | grep "^calibrate"

echo "== the demonstration, with the box's program of the package"
plumb demo --frames 120 --out demo
test -s demo/poses.csv -a -s demo/sway.svg

echo "== a study of six participants under two conditions"
mkdir study
{
    echo 'title = "Standing"'
    echo 'trials = []'
    echo 'conditions = ["open", "closed"]'
    echo 'bins_s = [[0, 10], [10, 20]]'
    echo 'figures = "all"'
} > study/study.toml
for participant in 1 2 3 4 5 6; do
    for condition in 1 2; do
        table=p$participant-c$condition.csv
        # A sway of some frequencies, of another size for each participant and condition.
        awk -v p=$participant -v c=$condition 'BEGIN {
            print "t,ap,ml"
            for (i = 0; i < 1800; i++) {
                t = i / 60; s = 2 + p / 3 + c
                printf "%.6f,%.6f,%.6f\n", t,
                    s * (sin(0.9 * t + p) + 0.4 * sin(2.3 * t * c + p) + 0.1 * sin(7.1 * t + c)),
                    s * (0.6 * sin(1.1 * t + 2 * p) + 0.2 * cos(3.7 * t + c))
            } }' > study/$table
        word=open; test $condition = 1 || word=closed
        {
            echo '[[trial]]'
            echo "table = \"$table\""
            echo 'columns = "time=t,ap=ap,ml=ml"'
            echo 'unit = "mm"'
            echo "participant = \"P$participant\""
            echo "condition = \"$word\""
        } >> study/study.toml
    done
done
plumb study study/study.toml --json study/by-plumb.json > study/by-plumb.txt
head -20 study/by-plumb.txt

echo "== the same by the wheel"
# With the system's NumPy, so that nothing is fetched.
python3 -m venv --system-site-packages python
python/bin/pip install --quiet --no-index ./plumbline-*.whl
python/bin/python - <<'PYTHON'
import json
import plumbline

study = plumbline.study("study/study.toml")
with open("study/by-plumb.json") as file:
    assert study == json.load(file), "the package and the program differ"
print(len(study["sway"]), "figures compared, each the same in both")
PYTHON
echo "all of it works in this Debian $(cat /etc/debian_version)"
