#!/bin/bash
# Prints the first lines of make demo: what it does, its duration, what is built first.   opening.sh BUILD SCENE
out=$1 scene=$2
echo "demo: runs $scene with two haptic devices and their controllers in real time (12 s), draws pictures and a video of it, and runs it again by other models:"
echo "demo: a minute or two once all is built, results in $out/demo; Ctrl-C ends it and leaves what is there."
if [ -x "$out/bin/tm-sim" ] && [ -e "$out/venv/.done" ]; then
    echo "demo: builds first what has changed since the last build."
else
    echo "demo: builds everything first (compiler lines follow): some four minutes on two cores, and installs what is missing of the Debian packages."
fi
