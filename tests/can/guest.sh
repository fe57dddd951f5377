#!/bin/bash
# Runs a shell script under a kernel that has CAN, whatever the host's kernel has.
#   tests/can/guest.sh uml|qemu vcan|controllers SECONDS RUN_DIR JOB.sh
# The guest sees the host's tree. The job finds CAN_A and CAN_B (the controller's and the device's interface, the same one on vcan)
# and OUT in its environment; what it leaves in OUT is in RUN_DIR/out afterwards. RUN_DIR/console.log is the guest's console.
# $TM_GUEST_UML: another user-mode Linux. Exit: the job's own status, 124 time-out, 125 the guest did not start. The console is printed when it is not 0.
set -uo pipefail
kind=$1 bus=$2 limit=$3 run=$4 job=$5
here=$(cd "$(dirname "$0")" && pwd)
kernel=${TM_GUEST_KERNEL:-$here/../../build/guest}
[ "$kind/$bus" = uml/controllers ] && { echo "guest: user-mode Linux has no emulated CAN controllers; use qemu" >&2; exit 2; }
rm -rf "$run" && mkdir -p "$run" || exit 125
run=$(cd "$run" && pwd)
cp "$here/guest/inside.sh" "$here/guest/init_uml.sh" "$run/" && cp "$job" "$run/job.sh" && chmod +x "$run/init_uml.sh" || exit 125

# One guest at a time: their timing is under test, and the host has few processors.
mkdir -p "$kernel"
exec 8>"$kernel/.guest"
flock 8
case $kind in
uml)
    # Pinned under a real-time policy the guest's own scheduling is what limits it. Without the right to, it runs as it can.
    pin=()
    last=$(($(nproc) - 1))
    [ "${TM_GUEST_PIN:-1}" = 1 ] && taskset -c $last chrt -f 50 true 2>/dev/null && pin=(taskset -c $last chrt -f 50)
    TMPDIR=/dev/shm timeout -k 5 "$limit" "${pin[@]}" "${TM_GUEST_UML:-linux.uml}" mem=512M root=/dev/root rootfstype=hostfs rootflags=/ rw quiet \
        panic=-1 init="$run/init_uml.sh" con0=fd:0,fd:1 con=null -- "tm_run=$run" </dev/null >"$run/console.log" 2>&1
    status=$?
    if [ $status != 124 ] && [ $status != 137 ]; then status=$(cat "$run/status" 2>/dev/null || echo 125); else status=124; fi ;;
qemu)
    "$here/guest/kernel.sh" "$kernel" || exit 125
    # icount makes the guest's time nearly repeatable; -smp 2 and shift=auto do not work with it.
    timeout -k 5 "$limit" qemu-system-x86_64 -M q35 -accel tcg -cpu max -smp 1 -m 512 -icount shift=1,sleep=off -nodefaults -no-reboot \
        -display none -serial stdio -kernel "$kernel/vmlinuz" -initrd "$kernel/initramfs.gz" \
        -append "console=ttyS0 quiet panic=-1 tm_run=$run tm_bus=$bus" \
        -object can-bus,id=canbus0 -device kvaser_pci,canbus=canbus0 -device kvaser_pci,canbus=canbus0 \
        -virtfs local,path=/,mount_tag=host,security_model=none,multidevs=remap \
        -device isa-debug-exit,iobase=0xf4,iosize=4 </dev/null >"$run/console.log" 2>&1
    status=$?
    if [ $status = 124 ] || [ $status = 137 ]; then status=124
    elif [ $((status & 1)) = 1 ]; then status=$((status >> 1))
    else status=125; fi ;;
*) echo "guest: no such guest '$kind'; use uml or qemu" >&2; exit 2 ;;
esac
if [ $status != 0 ]; then
    echo "guest: $kind $bus: status $status (124 time-out, 125 did not start); its console:" >&2
    tail -c 20000 "$run/console.log" >&2
fi
exit $status
