#!/bin/sh
# Installs oqtal as systemd services, or removes it. See docs/operations.md.
set -eu

usage() {
    cat <<'TEXT'
Usage: deploy/install.sh [--binary FILE] [--prefix DIR] [--root DIR]
       deploy/install.sh --uninstall [--prefix DIR] [--root DIR]

  --binary FILE  the program to install (default: target/release/oqtal beside this directory)
  --prefix DIR   /usr/local (the default) or /usr: systemd looks for units nowhere else
  --root DIR     put the files under DIR, for a package: nothing is started, stopped or registered
  --uninstall    stop the services and remove every file, including the configuration and drop-ins; the user if an installation
                 created it
TEXT
}

fail() { # EXIT-CODE MESSAGE
    printf 'install.sh: %s\n' "$2" >&2
    exit "$1"
}

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
binary=$here/../target/release/oqtal
prefix=/usr/local
root=
uninstall=no

while [ $# -gt 0 ]; do
    case $1 in
        --binary | --prefix | --root)
            [ $# -gt 1 ] || fail 64 "$1 requires a value; see --help"
            case $1 in
                --binary) binary=$2 ;;
                --prefix) prefix=$2 ;;
                --root)
                    # An empty directory would be this system itself.
                    case $2 in
                        *[!/]*) root=${2%/} ;;
                        *) fail 64 "--root requires the directory of a package, not '$2'; omit it to install on this system" ;;
                    esac
                    ;;
            esac
            shift
            ;;
        --uninstall) uninstall=yes ;;
        --help | -h) usage && exit 0 ;;
        *) usage >&2 && fail 64 "unknown option '$1'" ;;
    esac
    shift
done

prefix=${prefix%/}
case $prefix in
    /usr) other=/usr/local ;;
    /usr/local) other=/usr ;;
    *) fail 64 "--prefix must be /usr or /usr/local, where systemd looks for units, not '$prefix'" ;;
esac

bin=$root$prefix/bin
lib=$root$prefix/lib
share=$root$prefix/share/oqtal
man=$root$prefix/share/man/man1
etc=$root/etc/oqtal
units=$lib/systemd/system
# Exists if an installation created the user, who is then removed with it.
made_user=$share/made-user

# Whether this installs into the running system, not into the directory of a package.
live() {
    [ -z "$root" ] && [ -d /run/systemd/system ]
}

# File of the completions of a shell, where the shell looks for it.
completions() { # SHELL
    case $1 in
        bash) echo "$root$prefix/share/bash-completion/completions/oqtal" ;;
        zsh) echo "$root$prefix/share/zsh/site-functions/_oqtal" ;;
        fish) echo "$root$prefix/share/fish/vendor_completions.d/oqtal.fish" ;;
    esac
}

is_installed() { # PREFIX
    [ -e "$root$1/bin/oqtal" ] || [ -e "$root$1/share/oqtal/oqtal.toml" ]
}

put() { # FILE DIRECTORY, the program's path as installed
    install -d -m 755 "$2"
    sed "s|/usr/local/bin/oqtal|$prefix/bin/oqtal|g" "$1" >"$2/.new-$$"
    chmod 644 "$2/.new-$$"
    mv -f "$2/.new-$$" "$2/$(basename "$1")"
}

# The shipped configuration with every default commented out, so that presets take effect, and with the settings of services.
configuration() {
    awk '
        NR == 1 {
            print "# oqtal: the configuration of all services on this machine."
            print "# Every line that begins with \"# name = \" shows a default; remove the # to set it. Then check and restart:"
            print "#   oqtal check /etc/oqtal/oqtal.toml && systemctl try-restart \047oqtal-*.service\047"
            next
        }
        /^\[/ { section = $1 }
        section == "[instance]" && $1 == "root" { sub(/"".*/, "\"/run/oqtal\""); print; next }
        section == "[safety]" && $1 == "arm-at-start" { sub(/false/, "true "); print; next }
        # A value may extend over several lines, to that of its closing bracket.
        /^[a-z][a-z0-9-]* *=/ { print "# " $0; open = $0 ~ /= *\[ *(#.*)?$/; next }
        open { print "# " $0; open = $0 !~ /^\]/; next }
        { print }
    ' "$here/oqtal.toml"
}

install_files() {
    [ -f "$binary" ] || fail 64 "$binary does not exist; build it with 'cargo build --release', or name it with --binary"
    install -d -m 755 "$bin" "$share" "$etc"
    # Written under a new name first: a running program cannot be overwritten.
    install -m 755 "$binary" "$bin/.oqtal-new"
    mv -f "$bin/.oqtal-new" "$bin/oqtal"
    for unit in "$here"/systemd/*; do put "$unit" "$units"; done
    put "$here/sysusers.d/oqtal.conf" "$lib/sysusers.d"
    put "$here/tmpfiles.d/oqtal.conf" "$lib/tmpfiles.d"
    put "$here/udev/70-oqtal-radio.rules" "$lib/udev/rules.d"
    put "$here/udev/71-oqtal-crazyradio.rules" "$lib/udev/rules.d"
    # Not in force until an operator copies one.
    for drop_in in "$here"/drop-ins/*; do put "$drop_in" "$share"; done
    put "$here/oqtal.toml" "$share"
    install_configuration
    install_manual
}

# The program writes its own manual pages and completions, so that they are always those of its commands.
install_manual() {
    "$bin/oqtal" man "$man"
    for shell in bash zsh fish; do
        install -d -m 755 "$(dirname "$(completions $shell)")"
        "$bin/oqtal" completions $shell >"$(completions $shell)"
    done
    chmod 644 "$man"/oqtal*.1 "$(completions bash)" "$(completions zsh)" "$(completions fish)"
}

# An edited configuration is kept; the new defaults are then written beside it.
install_configuration() {
    configuration >"$share/etc-oqtal.toml.new"
    chmod 644 "$share/etc-oqtal.toml.new"
    if [ ! -f "$etc/oqtal.toml" ]; then
        cp "$share/etc-oqtal.toml.new" "$etc/oqtal.toml"
    elif [ -f "$share/etc-oqtal.toml" ] && cmp -s "$share/etc-oqtal.toml" "$etc/oqtal.toml"; then
        cp "$share/etc-oqtal.toml.new" "$etc/oqtal.toml"
    elif ! cmp -s "$share/etc-oqtal.toml.new" "$etc/oqtal.toml"; then
        printf 'install.sh: %s was edited and is kept; the shipped one is %s\n' "$etc/oqtal.toml" "$share/etc-oqtal.toml"
    fi
    mv -f "$share/etc-oqtal.toml.new" "$share/etc-oqtal.toml"
}

register() {
    if ! id oqtal >/dev/null 2>&1; then : >"$made_user"; fi
    systemd-sysusers "$lib/sysusers.d/oqtal.conf"
    systemd-tmpfiles --create "$lib/tmpfiles.d/oqtal.conf"
    systemctl daemon-reload
    # Without udev there are no adapters to name.
    if command -v udevadm >/dev/null 2>&1; then udevadm control --reload 2>/dev/null || true; fi
    "$bin/oqtal" check "$etc/oqtal.toml" >/dev/null || fail 78 "$etc/oqtal.toml is invalid, see above; correct it before the start"
    running=$(systemctl list-units --plain --no-legend --state=active 'oqtal-*.service' | awk '{ printf " %s", $1 }')
    if [ -n "$running" ]; then
        printf 'oqtal is updated; these services still run the old program. When nothing flies: systemctl restart%s\n' "$running"
    else
        printf 'oqtal is installed. To fly: systemctl start oqtal-sim.target; for the state: sudo oqtal ctl status\n'
    fi
}

unregister() {
    for unit in "$units"/oqtal-*; do
        [ -e "$unit" ] || continue
        # An operator's masks and drop-ins are removed first, since a masked unit cannot be disabled.
        systemctl --quiet revert "$(basename "$unit")" || true
        systemctl --quiet disable --now "$(basename "$unit")" || true
    done
}

remove_files() {
    rm -f "$bin/oqtal" "$units"/oqtal-daemon.service "$units"/oqtal-plant-sim.service \
        "$units"/oqtal-mocap-emu.service "$units"/oqtal-receiver.service "$units"/oqtal-bridge.service \
        "$units"/oqtal-sim.target \
        "$units"/oqtal-flight.target "$lib/sysusers.d/oqtal.conf" "$lib/tmpfiles.d/oqtal.conf" \
        "$lib/udev/rules.d/70-oqtal-radio.rules" "$lib/udev/rules.d/71-oqtal-crazyradio.rules" \
        "$share"/oqtal-bridge-network.conf "$share"/oqtal-bridge-radio.conf "$share"/oqtal-receiver-chain.conf "$etc/oqtal.toml" "$share/oqtal.toml" "$share/etc-oqtal.toml" \
        "$made_user" "$man/oqtal.1" "$man"/oqtal-*.1 "$(completions bash)" "$(completions zsh)" "$(completions fish)"
    # Directories that are not empty are kept.
    for directory in "$etc" "$share" "$man" "$units" "$lib/systemd" "$lib/sysusers.d" "$lib/tmpfiles.d" "$lib/udev/rules.d" \
        "$lib/udev"; do
        rmdir "$directory" 2>/dev/null || true
    done
    # The directory of a shell below share, too: no other program may have written completions.
    for shell in bash zsh fish; do
        directory=$(dirname "$(completions $shell)")
        rmdir "$directory" "$(dirname "$directory")" 2>/dev/null || true
    done
}

# Removes the run-time files of the services. A failure here does not prevent the other steps.
forget() { # whether an installation created the user: yes or no
    rm -rf /run/oqtal /var/cache/oqtal
    # Selected by owner: other users may have instances.
    if id oqtal >/dev/null 2>&1; then find /dev/shm -maxdepth 1 -user oqtal -name 'oqtal_*' -exec rm -rf {} + || true; fi
    systemctl daemon-reload || true
    systemctl reset-failed 'oqtal-*' 2>/dev/null || true
    if command -v udevadm >/dev/null 2>&1; then udevadm control --reload 2>/dev/null || true; fi
    if [ "$1" = yes ]; then forget_user; fi
}

forget_user() {
    if id oqtal >/dev/null 2>&1 && ! userdel oqtal; then
        printf 'install.sh: the user oqtal is kept; end its processes (ps -u oqtal), then: userdel oqtal\n' >&2
        return
    fi
    if getent group oqtal >/dev/null; then groupdel oqtal || true; fi
}

# Only one installation is allowed: systemd would use the units of one of two, possibly not those that the operator sees.
check_prefix() {
    if is_installed "$other" && ! { [ "$uninstall" = yes ] && is_installed "$prefix"; }; then
        fail 64 "oqtal is installed under $root$other; $1"
    fi
}

if [ -z "$root" ] && [ "$(id -u)" -ne 0 ]; then
    fail 77 "must run as root, or with --root DIR to build a package"
fi
if [ "$uninstall" = yes ]; then
    check_prefix "give --prefix $other"
    made=no
    if [ -e "$made_user" ]; then made=yes; fi
    if live; then unregister; fi
    remove_files
    if live; then forget "$made"; fi
else
    check_prefix "update that with --prefix $other, or remove it first: --uninstall --prefix $other"
    install_files
    if live; then register; fi
fi
