# Runs inside the guest once the host's tree is its root:   dash inside.sh RUN_DIR
# Brings up the buses, runs RUN_DIR/job.sh with OUT, a directory in the guest's memory, in its environment, and copies OUT to RUN_DIR/out. No file of the host is written
# elsewhere.
run=$1
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t devtmpfs dev /dev
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mkdir -p /dev/shm
# Not over /tmp: the checkout itself may be there.
mkdir -p "$run/memory" && mount -t tmpfs tmpfs "$run/memory" || exit 125
mount -t tmpfs tmpfs /dev/shm
mkdir -p "$run/memory/out"
export OUT="$run/memory/out" TMPDIR="$run/memory" HOME="$run/memory"
/bin/ip link set lo up
/bin/ip route add 224.0.0.0/4 dev lo
/bin/ip link add vcan0 type vcan || exit 125
/bin/ip link set vcan0 up || exit 125
for i in can0 can1; do
    /bin/ip link set $i type can bitrate 1000000 restart-ms 100 || exit 125
    /bin/ip link set $i txqueuelen 64 up || exit 125
done
cd "$TMPDIR"
/bin/bash "$run/job.sh"
status=$?
/bin/ip -details -statistics link show > "$OUT/links.txt" 2>&1
mkdir -p "$run/out"
cp -r "$OUT/." "$run/out/" || status=125
sync
exit $status
