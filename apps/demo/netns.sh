#!/bin/bash
# Makes a network namespace for a session: messages stay on this machine, and sessions do not receive each other's.
#   netns.sh run PIDFILE COMMAND...    runs COMMAND in a new network namespace with multicast on loopback; its pid goes to PIDFILE
#   netns.sh join PIDFILE COMMAND...   runs COMMAND in the namespace of the process named in PIDFILE
# If namespaces are not permitted, COMMAND runs in the machine's own network, with a message. Exit 2: nothing to join.
set -u
mode=$1 pidfile=$2
shift 2

case $mode in
run)
    if [ "$(id -u)" = 0 ]; then new=(unshare -n); else new=(unshare -r -n); fi
    if "${new[@]}" sh -c 'ip link set lo up && ip route add 224.0.0.0/4 dev lo' 2>/dev/null; then
        exec "${new[@]}" sh -c 'ip link set lo up; ip route add 224.0.0.0/4 dev lo; echo $$ > "$1"; shift; exec "$@"' sh "$pidfile" "$@"
    fi
    echo "netns: network namespaces are not permitted here, so messages use this machine's own network (ttl=0: they stay on it);" \
         "docs/troubleshooting-network.md, 'No network namespaces', tells how to permit them" >&2
    echo $$ > "$pidfile"
    exec "$@"
    ;;
join)
    pid=$(cat "$pidfile" 2>/dev/null)
    if [ -z "$pid" ] || [ ! -e "/proc/$pid/ns/net" ]; then
        echo "netns: no session runs ($pidfile names no living process); start \`make demo\` or \`make play\` first" >&2
        exit 2
    fi
    if [ "$(readlink "/proc/$pid/ns/net")" = "$(readlink /proc/self/ns/net)" ]; then exec "$@"; fi
    if [ "$(id -u)" = 0 ]; then exec nsenter -t "$pid" -n "$@"; fi
    exec nsenter -t "$pid" -U --preserve-credentials -n "$@"
    ;;
*)
    echo "netns: '$mode' is not run or join" >&2
    exit 2
    ;;
esac
