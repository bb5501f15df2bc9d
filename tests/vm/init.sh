#!/bin/busybox sh
# First process of the micro-machine: brings up two CAN buses and two cameras, mounts the host's
# root read-only under a tmpfs overlay, runs /share/command there and leaves its exit status.
# Whatever fails on the way ends the machine: the kernel panics without its first process.
set -e
/bin/busybox mkdir /bin/applets
/bin/busybox --install -s /bin/applets
export PATH=/bin/applets
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs devtmpfs /dev
webcams='n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x0'
for module in /modules/*.ko; do
    case $module in
        *vivid*) insmod "$module" $webcams ;;
        *) insmod "$module" ;;
    esac
done

ip link set lo up
for bus in vcan0 vcan1; do
    ip link add dev $bus type vcan
    ip link set $bus up
done
# Bursts overflow a socket's default buffer after some 280 CAN frames.
echo 8388608 > /proc/sys/net/core/rmem_default

mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,ro root /host
mount -t tmpfs tmpfs /overlay
mkdir /overlay/upper /overlay/scratch
mount -t overlay -o lowerdir=/host,upperdir=/overlay/upper,workdir=/overlay/scratch overlay /newroot
mkdir -p /newroot/share /dev/shm /dev/pts
mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000 share /newroot/share
mount -t tmpfs tmpfs /dev/shm
mount -t devpts devpts /dev/pts
mount --rbind /dev /newroot/dev
mount -t proc proc /newroot/proc
mount -t sysfs sysfs /newroot/sys
mount -t tmpfs tmpfs /newroot/run

status=0
output=/dev/$(ls /sys/class/virtio-ports)
chroot /newroot /bin/sh /share/command > "$output" 2>&1 < /dev/null || status=$?
echo $status > /newroot/share/status
poweroff -f
