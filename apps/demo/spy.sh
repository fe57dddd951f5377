#!/bin/bash
# make spy: runs the stock lcm-spy with this project's types in the network of the running session. Exit 2, with a remedy, if something is missing.
#   OUT=build apps/demo/spy.sh [options of lcm-spy]
set -u
here=$(cd "$(dirname "$0")" && pwd)
out=${OUT:-build}
types=$out/java/tensormass_types.jar
jars=/usr/share/java/lcm.jar:/usr/share/java/jchart2d.jar

say() { echo "spy: $*" >&2; exit 2; }
command -v java >/dev/null || say "no Java here; run tools/setup.sh spy, or apt-get install default-jre libjchart2d-java liblcm-java"
for jar in ${jars//:/ }; do
    [ -f "$jar" ] || say "$jar is missing; run tools/setup.sh spy, or apt-get install libjchart2d-java liblcm-java"
done
[ -n "${DISPLAY:-}" ] || say "no display (DISPLAY is not set); run it on a desktop or over ssh -X, or look at a log with tm-view and docs/viewing.md"
if [ ! -f "$types" ]; then
    command -v javac >/dev/null || say "the message types are not built and there is no javac to build them; run tools/setup.sh spy, or apt-get install default-jdk-headless"
fi
make -s "$types" || say "the message types could not be built; see the message above"

running() {
    for name in demo play; do
        pid=$(cat "$out/$name/netns.pid" 2>/dev/null) && [ -e "/proc/$pid/ns/net" ] && echo "$out/$name/netns.pid" && return
    done
}
session=$(running)
patience=${SPY_WAIT:-60} # `make demo & make spy`: the demo may be building still
[ -n "$session" ] || [ "$patience" = 0 ] || echo "spy: waiting up to $patience s for a session (make demo, make play)" >&2
for ((i = 0; i < 2 * patience && ${#session} == 0; i++)); do sleep 0.5; session=$(running); done
[ -n "$session" ] || say "no session runs; start \`make demo\` or \`make play\` in another terminal, then \`make spy\` again"
echo "spy: joining the session of $session" >&2
# Debian's own lcm-spy script passes an option that Java 17 no longer takes.
# Only display.py connects a namespace to the display of `ssh -X`.
exec "$here/display.py" "$here/netns.sh" join "$session" java -cp "$jars:$types" lcm.spy.Spy "$@"
