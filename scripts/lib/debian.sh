# Sourced by scripts/sysroot and scripts/image: Debian packages for the board, of versions that are written down. Every
# package that is unpacked stands in the list below with its version and its file's SHA-256; one that a mirror has
# in another version, or that is missing from the list, ends the build. scripts/image --update-packages renews the list.
package_list=boards/image/packages.lock
default_mirror=http://deb.debian.org/debian

# The names in files of packages, with commas between them.
read_packages() { sed 's/#.*//' "$@" | tr -s ' \n' '\n' | grep . | sort -u | paste -sd,; }

# The lines of sources.list for a mirror ("": Debian's own): the release, its updates, and security.
debian_sources() {
  local mirror=${1:-$default_mirror} security suite
  security=$(echo "$mirror" | sed -E 's,^(https?://[^/]+(/[^/]+)*)/debian(/.*)?$,\1/debian-security\3,')
  [ "$security" != "$mirror" ] || { echo "$mirror: expected a URL with /debian in its path" >&2; return 1; }
  for suite in trixie trixie-updates; do echo "deb $mirror $suite main non-free-firmware"; done
  echo "deb $security trixie-security main non-free-firmware"
}

# What the hook of unpack_debian runs: each file's package, version, architecture, SHA-256, source package and its
# version, tab-separated; in $2.files each file's path and its package.
describe_packages() {
  local deb
  : >"$2.files"
  for deb in "$1"/var/cache/apt/archives/*.deb; do
    dpkg-deb -W --showformat="\${Package}\t\${Version}\t\${Architecture}\t$(sha256sum <"$deb" | cut -d' ' -f1)\t\${source:Package}\t\${source:Version}\n" "$deb"
    dpkg-deb --fsys-tarfile "$deb" | tar -t | sed "s|\$|\t$(dpkg-deb -f "$deb" Package)|" >>"$2.files"
  done | sort >"$2"
}

# Packages of file $1 that do not stand in the list like this: says which, and ends the build.
check_packages() {
  local wrong
  wrong=$(awk -F'\t' 'NR == FNR { known[$1, $3] = $2; line[$1, $2, $3, $4] = 1; next }
    !line[$1, $2, $3, $4] { was = known[$1, $3]
      print "  " $1 " " $2 " (" $3 "): " (was == "" ? "not in the list" : was == $2 ? "other bytes than listed" : "the list has " was) }' \
    "$package_list" "$1")
  [ -z "$wrong" ] && return
  echo "The mirror's packages are not those of $package_list:" >&2
  echo "$wrong" | head -20 >&2
  echo "Renew the list with scripts/image --update-packages, or take an older mirror (--mirror, see --help)." >&2
  return 1
}

# unpack_debian ARCH PACKAGES MIRROR DESCRIPTION LOG: the packages and all that they need as a tar on standard output.
# "extract" unpacks and runs none of their scripts: no emulation, no chroot, no root.
unpack_debian() {
  local arch=$1 packages=$2 mirror=$3 description=$4 log=$5 sources
  sources=$(debian_sources "$mirror") || return 1
  mmdebstrap --architectures="$arch" --variant=extract --include="$packages" \
    --aptopt='Acquire::Check-Valid-Until "false"' \
    --extract-hook="bash -c 'set -e; . \"$PWD/scripts/lib/debian.sh\"; describe_packages \"\$0\" \"$PWD/$description\"' \"\$1\"" \
    trixie - - <<<"$sources" 2>"$log"
}

# list_packages ARCH PACKAGES MIRROR: what unpack_debian would take today, as lines of the list.
list_packages() {
  local apt
  apt=$(mktemp -d)
  mkdir -p "$apt"/{lists/partial,archives/partial}
  : >"$apt/status"
  debian_sources "$3" >"$apt/sources"
  cat >"$apt/conf" <<CONF
APT::Architecture "$1"; APT::Architectures "$1"; APT::Install-Recommends "false"; APT::Sandbox::User "root";
Dir::State "$apt"; Dir::State::status "$apt/status"; Dir::State::lists "$apt/lists"; Dir::Cache "$apt"; Dir::Etc::sourcelist "$apt/sources";
Dir::Etc::sourceparts "/dev/null"; Dir::Etc::preferencesparts "/dev/null"; Acquire::Check-Valid-Until "false";
CONF
  APT_CONFIG=$apt/conf apt-get update -qq &&
    APT_CONFIG=$apt/conf apt-get install --simulate -y ${2//,/ } | sed -n 's/^Inst \(\S*\) (\(\S*\) .*/\1=\2/p' |
      APT_CONFIG=$apt/conf xargs apt-cache show |
      awk -v OFS='\t' -F': ' '/^Package:/ { p = $2 } /^Version:/ { v = $2 } /^Architecture:/ { a = $2 } /^SHA256:/ { print p, v, a, $2 }'
  rm -rf "$apt"
}
