#!/bin/sh
# Installs a former package into a folder, upgrades it, removes and purges it, and checks the remaining files each time. No service is
# started and nothing outside of the folder is changed; the maintainer scripts run as dpkg runs them for such an installation.
#   install.sh FORMER.deb PACKAGE.deb
set -eu

former=$1
package=$2
if [ "$(id -u)" != 0 ] || ! command -v dpkg >/dev/null; then
    echo 'not run: this test needs dpkg and root' >&2
    exit 0
fi

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/var/lib/dpkg/updates" "$root/var/lib/dpkg/info" "$root/etc"
touch "$root/var/lib/dpkg/status" "$root/var/lib/dpkg/available"
# Files of an existing system: root and the groups that own files.
getent passwd root >"$root/etc/passwd"
getent group root >"$root/etc/group"

wrong() {
    echo "wrong: $*" >&2
    exit 1
}

in_root() {
    # The dependencies are installed on the machine, not in the folder.
    dpkg --root="$root" --force-script-chrootless --force-depends --log="$root/dpkg.log" "$@" 2>"$root/said" >"$root/told" ||
        { cat "$root/told" "$root/said" >&2; wrong "dpkg $*"; }
}

version() {
    dpkg-query --admindir="$root/var/lib/dpkg" -W -f '${Status} ${Version}' panelprep 2>/dev/null || true
}

# Files that a cell has created since its installation.
fill() {
    echo 'store = "/var/lib/panelprep"' >"$root/etc/panelprep/cell.toml"
    mkdir "$root/etc/panelprep/calibration" "$root/var/lib/panelprep/blobs"
    echo '[camera]' >"$root/etc/panelprep/calibration/scanner.toml"
    echo rows >"$root/var/lib/panelprep/panelprep.sqlite"
    echo picture >"$root/var/lib/panelprep/blobs/0123"
}

sums() {
    find "$root/etc/panelprep" "$root/var/lib/panelprep" -type f -exec sha256sum {} + | sort
}

in_root --install "$former"
version | grep -q 'install ok installed' || wrong "installed: $(version)"
before=$(version)
[ "$(stat -c %U:%a "$root/var/lib/panelprep")" != '' ] || wrong 'no store folder'
grep -q '^panelprep:' "$root/etc/passwd" || wrong 'no user panelprep'
owner=$(awk -F: '$1 == "panelprep" { print $3 ":" $4 }' "$root/etc/passwd")
[ "$(stat -c %u:%g "$root/var/lib/panelprep")" = "$owner" ] || wrong 'the store is not the service'\''s'
[ "$(stat -c %a "$root/var/lib/panelprep")" = 750 ] || wrong 'the store can be read by all'
[ "$(stat -c %u:%g "$root/etc/panelprep")" = "$owner" ] || wrong 'the configuration is not the service'\''s user'\''s'
[ -z "$(ls "$root/etc/panelprep")" ] || wrong 'the package put a file into /etc/panelprep'
grep -q 'panelprep new cell' "$root/told" || wrong 'nobody is told what to do next'
for file in usr/bin/panelprep usr/lib/systemd/system/panelprep.service usr/share/panelprep/cell-example.toml \
    usr/share/panelprep/kuka/cell_submit.src usr/share/panelprep/kuka/CELLCMD.xml usr/share/man/man1/panelprep-restore.1.gz \
    usr/share/doc/panelprep/trial.md usr/share/doc/panelprep/manual/install.md usr/share/doc/panelprep/manual/drawing.png \
    usr/share/bash-completion/completions/panelprep usr/share/doc/panelprep/copyright; do
    [ -s "$root/$file" ] || wrong "no $file"
done
"$root/usr/bin/panelprep" check "$root/usr/share/panelprep/cell-example.toml" "$root"/usr/share/panelprep/panels/*.toml \
    "$root"/usr/share/panelprep/kuka/*.xml >"$root/told" || { cat "$root/told"; wrong 'what was installed is not right'; }
for crate in libsqlite3-sys zstd-sys opencv; do
    grep -q "^ *$crate " "$root/usr/share/doc/panelprep/copyright" || wrong "no licence of $crate"
done

fill
kept=$(sums)
in_root --install "$package"
[ "$(version)" != "$before" ] || wrong 'the version is the former one'
[ "$(sums)" = "$kept" ] || wrong 'the upgrade changed store or configuration'
grep -q 'systemctl restart panelprep' "$root/told" || wrong 'nobody is told to restart the service'

in_root --remove panelprep
[ ! -e "$root/usr/bin/panelprep" ] || wrong 'the program is still there'
[ "$(sums)" = "$kept" ] || wrong 'the removal changed store or configuration'
in_root --purge panelprep
[ "$(sums)" = "$kept" ] || wrong 'the purge changed store or configuration'
grep -q '/var/lib/panelprep is kept' "$root/told" || wrong 'the purge does not say what it keeps'
left=$(find "$root" -path "$root/var/lib/dpkg" -prune -o -type f -print | grep -v -e "^$root/etc/panelprep/" -e "^$root/var/lib/panelprep/" \
    -e "^$root/etc/\(passwd\|group\|shadow\|gshadow\)-\?$" -e "^$root/etc/.pwd.lock$" -e "^$root/\(dpkg.log\|said\|told\)$" || true)
[ -z "$left" ] || wrong "left after the purge: $left"

# If no file was created, no file remains.
rm -rf "$root/etc/panelprep" "$root/var/lib/panelprep"
in_root --install "$package"
in_root --purge panelprep
[ ! -e "$root/etc/panelprep" ] && [ ! -e "$root/var/lib/panelprep" ] || wrong 'empty folders stay after a purge'
echo 'installed, upgraded, removed and purged; store and configuration stayed'

# Checks the units as systemd reads them, with and without the files beside them.
if command -v systemd-analyze >/dev/null; then
    in_root --install "$package"
    for dropin in '' panelprep-zivid.conf panelprep-network.conf; do
        units=$(mktemp -d -p "$root")
        sed "s#/usr/bin/panelprep#$root/usr/bin/panelprep#" "$root/usr/lib/systemd/system/panelprep.service" >"$units/panelprep.service"
        if [ -n "$dropin" ]; then
            mkdir "$units/panelprep.service.d"
            cp "$root/usr/share/panelprep/$dropin" "$units/panelprep.service.d/$dropin"
        fi
        said=$(SYSTEMD_UNIT_PATH="$units:" systemd-analyze verify --man=no panelprep.service 2>&1) || wrong "systemd: $said"
        # systemd reports an unknown line, but does not treat it as an error.
        [ -z "$(echo "$said" | grep -F "$units" || true)" ] || wrong "systemd: $said"
    done
    echo 'systemd-analyze verify takes the units'
else
    echo 'not run: systemd-analyze is not here' >&2
fi
