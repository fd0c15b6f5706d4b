#!/bin/sh
# Measures the GPU of this machine: ./run.sh OUT [ADAPTER]
#
# Writes results.jsonl, log.txt and images to the folder OUT, most important figures first, within eight minutes.
# ADAPTER is a part of a GPU's name, where there are several. Needs a shell, the C library and a graphics driver.

if [ $# -lt 1 ] || [ $# -gt 2 ] || [ "$1" = --help ] || [ "$1" = -h ]; then
    echo "usage: ./run.sh OUT [ADAPTER]" >&2
    exit 2
fi
kit=$(cd "$(dirname "$0")" && pwd) || exit 1
mkdir -p "$1" || exit 1
out=$(cd "$1" && pwd) || exit 1
adapter=${2:-}
log=$out/log.txt
results=$out/results.jsonl
if [ -s "$results" ]; then
    echo "error: $results is there from another run, expected a new or empty folder" >&2
    exit 2
fi
begin=$(date +%s)
# Time limit of all steps together, in seconds; the rest of eight minutes is for steps to end. A larger value, for a
# busy or slow machine, also raises the limit of each step.
usual=465
total=${SURFEL_KIT_SECONDS:-$usual}

say() {
    echo "$*"
    echo "$*" >>"$log"
}

# Prints a message, and appends it to the results, whose page shows it.
note() {
    say "$*"
    text=$(printf '%s' "$*" | tr -d '"\\' | tr '\n' ' ')
    printf '{"kind":"note","text":"%s"}\n' "$text" >>"$results"
}

cat "$kit/kit.json" >"$results"
say "kit: $(cat "$kit/kit.json")"
say "system: $(uname -a)"
[ -r /etc/os-release ] && say "system: $(grep -h PRETTY_NAME /etc/os-release)"
[ -r /proc/driver/nvidia/version ] && say "driver: $(head -n 1 /proc/driver/nvidia/version)"

# Windows are not needed, and a display that can't be reached may make a driver fail. Drivers need a folder in which
# they may write compiled shaders and sockets.
unset DISPLAY WAYLAND_DISPLAY
own=$out/home
mkdir -p -m 700 "$own" || exit 1
[ -w "${HOME:-/nonexistent}" ] || HOME=$own
XDG_RUNTIME_DIR=$own
export HOME XDG_RUNTIME_DIR

# --- programs: do they start, and if not, why?

glibc=$(sed -n 's/.*"glibc":"\([0-9.]*\)".*/\1/p' "$kit/kit.json")
if ! complaint=$("$kit/gpu-kit" bench --help 2>&1); then
    case $complaint in
    *libgcc_s*)
        note "missing: libgcc_s.so.1; the kit's own is used"
        LD_LIBRARY_PATH=$kit/libgcc${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
        export LD_LIBRARY_PATH
        ;;
    esac
    if ! complaint=$("$kit/gpu-kit" bench --help 2>&1); then
        note "FAILED: the programs don't start: $complaint"
        note "They need an x86-64 Linux with glibc $glibc or later; this one has: $(ldd --version 2>&1 | head -n 1)"
        exit 1
    fi
fi

# --- Vulkan: loader, driver, device

# Prints the first file of this name in the folders where libraries are.
library() {
    found=$(ldconfig -p 2>/dev/null | sed -n "s|.*[[:space:]]$1 .*=> ||p" | head -n 1)
    if [ -n "$found" ] && [ -e "$found" ]; then
        echo "$found"
        return
    fi
    IFS_before=$IFS
    IFS=:
    for folder in ${LD_LIBRARY_PATH:-} /usr/lib/x86_64-linux-gnu /lib/x86_64-linux-gnu /usr/lib64 /lib64 /usr/lib /lib \
        /usr/local/lib /usr/local/lib64 /usr/local/nvidia/lib64 /usr/local/nvidia/lib /usr/lib/wsl/lib \
        /run/opengl-driver/lib; do
        if [ -n "$folder" ] && [ -e "$folder/$1" ]; then
            echo "$folder/$1"
            break
        fi
    done
    IFS=$IFS_before
}

loader=$(library libvulkan.so.1)
if [ -z "$loader" ]; then
    note "missing: the Vulkan loader, libvulkan.so.1; the kit's own is used"
    LD_LIBRARY_PATH=$kit/vulkan${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
    export LD_LIBRARY_PATH
else
    say "loader: $loader"
    # The loader may be in a folder where only this script searches.
    LD_LIBRARY_PATH=${LD_LIBRARY_PATH:+$LD_LIBRARY_PATH:}$(dirname "$loader")
    export LD_LIBRARY_PATH
fi

# True if the step `devices` finds a GPU. `seen` is its exit code: 0 for a GPU, 3 for devices that compute on the CPU
# only, 4 for no device.
sees_gpu() {
    rm -rf "$out/probe" && mkdir "$out/probe"
    limited 30 "$kit/gpu-kit" bench kit devices --out "$out/probe" ${adapter:+--adapter "$adapter"}
    seen=$status
    [ "$seen" -eq 0 ]
}

# Runs a command for at most the given number of seconds; its output goes to the log. `status` is its exit code, or 124
# if it was stopped.
limited() {
    seconds=$1
    shift
    "$@" >>"$log" 2>&1 &
    child=$!
    (
        # If this guard process is stopped, its `sleep` is stopped, too.
        trap 'kill $!; exit' TERM
        sleep "$seconds" &
        wait $!
        : >"$out/over"
        kill -9 $child
    ) >/dev/null 2>&1 &
    guard=$!
    wait $child 2>/dev/null
    status=$?
    kill $guard 2>/dev/null
    wait $guard 2>/dev/null
    if [ -e "$out/over" ]; then
        rm -f "$out/over"
        status=124
    fi
}

# Points the loader to a file that names a driver.
use_driver() {
    VK_DRIVER_FILES=$1
    VK_ICD_FILENAMES=$1
    export VK_DRIVER_FILES VK_ICD_FILENAMES
}

# Looks for a GPU through drivers that the loader doesn't find by itself.
try_drivers() {
    for file in /usr/local/nvidia/share/vulkan/icd.d/*.json /run/opengl-driver/share/vulkan/icd.d/*.json \
        /opt/*/share/vulkan/icd.d/*.json /usr/local/*/share/vulkan/icd.d/*.json; do
        [ -e "$file" ] || continue
        use_driver "$file"
        if sees_gpu; then
            note "driver: $file, which the loader doesn't find by itself"
            return
        fi
    done
    # A container often has the driver's libraries without the file that names them. libGLX_nvidia needs X libraries,
    # libEGL_nvidia does not.
    libraries_of_loader=$LD_LIBRARY_PATH
    for name in libGLX_nvidia.so.0 libEGL_nvidia.so.0; do
        file=$(library $name)
        [ -n "$file" ] || continue
        json=$out/driver.json
        printf '{"file_format_version":"1.0.0","ICD":{"library_path":"%s","api_version":"1.3.0"}}\n' "$file" >"$json"
        use_driver "$json"
        LD_LIBRARY_PATH=$libraries_of_loader:$(dirname "$file")
        if sees_gpu; then
            note "driver: $file, for which driver.json in the output folder was written"
            return
        fi
        lacking=$(ldd "$file" 2>/dev/null | sed -n 's/[[:space:]]*\(.*\) => not found/\1/p' | tr '\n' ' ')
        say "$file shows no device${lacking:+; it lacks: $lacking}"
        LD_LIBRARY_PATH=$libraries_of_loader
    done
}

if ! sees_gpu; then
    first=$seen
    before=${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}
    libraries_before=$LD_LIBRARY_PATH
    say "no GPU is seen as the machine is set up: other places of drivers are tried"
    try_drivers
    # A driver may be whole but for the libraries of EGL and GLX, which containers often lack.
    if [ "$seen" -ne 0 ] && [ -d "$kit/glvnd" ]; then
        say "the kit's own libraries of EGL and GLX are tried"
        unset VK_DRIVER_FILES VK_ICD_FILENAMES
        [ -n "$before" ] && use_driver "$before"
        LD_LIBRARY_PATH=$libraries_before:$kit/glvnd
        sees_gpu || try_drivers
        [ "$seen" -eq 0 ] && note "missing: libraries of EGL or GLX, which the driver needs; the kit's own are used"
    fi
    if [ "$seen" -ne 0 ]; then
        LD_LIBRARY_PATH=$libraries_before
        unset VK_DRIVER_FILES VK_ICD_FILENAMES
        [ -n "$before" ] && use_driver "$before"
        seen=$first
        for device in /dev/nvidia0 /dev/nvidiactl /dev/dri/renderD128 /dev/kfd /dev/dxg; do
            [ -e "$device" ] && note "missing: a Vulkan driver for $device, which is there"
        done
    fi
fi
rm -rf "$out/probe"
small=
case $seen in
0) ;;
3)
    note "missing: a GPU; the devices that are there compute on the CPU, so that small images are measured"
    small=--small
    # Mesa compiles hundreds of shaders for small images. Without optimising them, the steps take a fifth less time.
    GALLIVM_PERF=${GALLIVM_PERF:-nopt}
    export GALLIVM_PERF
    ;;
*)
    note "missing: a Vulkan device; only the CPU is measured"
    ;;
esac

# --- steps

# step LIMIT NAME COMMAND…: runs a step within its limit and the time that is left.
step() {
    limit=$1
    name=$2
    shift 2
    started=$(date +%s)
    left=$((begin + total - started))
    [ "$total" -gt "$usual" ] && limit=$((limit * total / usual))
    [ "$left" -lt "$limit" ] && limit=$left
    if [ "$limit" -le 0 ]; then
        outcome="FAILED: left out, the time is over"
    else
        say "== $name (at most $limit s)"
        limited "$limit" "$@"
        case $status in
        0) outcome=ok ;;
        124) outcome="FAILED: stopped after $limit s; what it had measured is kept" ;;
        *) outcome="FAILED: exit code $status; log.txt says more" ;;
        esac
    fi
    took=$(($(date +%s) - started))
    say "$name: $outcome ($took s)"
    # Ends the line that a killed step left incomplete.
    [ -n "$(tail -c 1 "$results")" ] && echo >>"$results"
    printf '{"kind":"step","name":"%s","seconds":%s,"outcome":"%s"}\n' "$name" "$took" "$outcome" >>"$results"
}

# Each of these functions runs in a shell of its own, which `exec` replaces by the program, so that killing the shell
# ends the program.
bench() {
    exec "$kit/gpu-kit" bench kit "$@" --out "$out" ${adapter:+--adapter "$adapter"} $small
}
conformance() {
    exec "$kit/gpu-kit" conformance --backend "$1" --truths "$kit/truths.gz" --out "$out" --no-validation \
        ${adapter:+--adapter "$adapter"}
}
image() {
    exec "$kit/surfel" render "$kit/spot/spot.json" --backend "$1" -o "$out/spot-$1.png" --force
}
devices() {
    "$kit/gpu-kit" bench kit devices --out "$out" ${adapter:+--adapter "$adapter"}
    code=$?
    # The step hasn't failed if there is no GPU (3) or no device (4).
    [ $code -eq 0 ] || [ $code -eq 3 ] || [ $code -eq 4 ]
}

step 30 devices devices
if [ "$seen" -eq 0 ] || [ "$seen" -eq 3 ]; then
    step 90 "frames on ash" bench frames ash
    step 90 "frames on wgpu" bench frames wgpu
    step 150 "conformance of ash" conformance ash
    step 150 "conformance of wgpu" conformance wgpu
    step 40 probes bench probes
    step 15 "image by ash" image ash
    step 15 "image by wgpu" image wgpu
fi
step 15 "image by cpu" image cpu
step 90 "frames on cpu" bench frames cpu

rm -rf "$own"
say "== $(($(date +%s) - begin)) s; copy $out back and run: cargo xtask gpu-report OUT"
failed=$(grep -c FAILED "$log")
say "$failed lines of the log say FAILED"
[ "$failed" -eq 0 ]
