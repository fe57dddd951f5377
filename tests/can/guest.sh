#!/bin/bash
# Runs a shell script under a kernel with CAN, independent of the host's kernel: Debian's, in QEMU.
#   tests/can/guest.sh SECONDS RUN_DIR JOB.sh
# The guest sees the host's tree and has a bus vcan0, and another with two controllers on it, can0 and can1. The job finds OUT in its environment; files that it leaves there
# is in RUN_DIR/out afterwards. RUN_DIR/console.log is the guest's console.
# Exit: the job's own status, 124 time-out, 125 the guest did not start. The console is printed if it is not 0.
set -uo pipefail
limit=$1 run=$2 job=$3
here=$(cd "$(dirname "$0")" && pwd)
kernel=${TM_GUEST_KERNEL:-$here/../../build/guest}
rm -rf "$run" && mkdir -p "$run" || exit 125
run=$(cd "$run" && pwd)
cp "$here/guest/inside.sh" "$run/" && cp "$job" "$run/job.sh" || exit 125
"$here/guest/kernel.sh" "$kernel" || exit 125
# icount: the guest's time is counted in its instructions, independent of the host's load. -smp 2 and shift=auto do not work with it.
timeout -k 5 "$limit" qemu-system-x86_64 -M q35 -accel tcg -cpu max -smp 1 -m 512 -icount shift=1,sleep=off -nodefaults -no-reboot \
    -display none -serial stdio -kernel "$kernel/vmlinuz" -initrd "$kernel/initramfs.gz" \
    -append "console=ttyS0 quiet cryptomgr.notests panic=-1 tm_run=$run" \
    -object can-bus,id=canbus0 -device kvaser_pci,canbus=canbus0 -device kvaser_pci,canbus=canbus0 \
    -virtfs local,path=/,mount_tag=host,security_model=none,multidevs=remap \
    -device isa-debug-exit,iobase=0xf4,iosize=4 </dev/null >"$run/console.log" 2>&1
status=$?
if [ $status = 124 ] || [ $status = 137 ]; then status=124
elif [ $((status & 1)) = 1 ]; then status=$((status >> 1))
else status=125; fi
if [ $status != 0 ]; then
    echo "guest: status $status (124 time-out, 125 did not start); its console:" >&2
    tail -c 20000 "$run/console.log" >&2
fi
exit $status
