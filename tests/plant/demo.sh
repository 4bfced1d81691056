#!/bin/sh
# The whole plant on this computer: `make demo-plant`. Two simulated cells with their services, a NATS broker, PostgreSQL, the archive, the
# web page of the office server, and an MQTT broker with the live view of MQTT Sparkplug. Each cell runs one cycle; then the archive is
# compared with both cells. The servers run until Ctrl-C; with ONCE=1 they end after the comparison. All files are in the given folder, and
# every server listens only on this computer.
set -eu

program=$(realpath "$1")
mkdir -p "$2"
folder=$(realpath "$2")
broker_port=${BROKER_PORT:-14222}
database_port=${DATABASE_PORT:-15432}
fleet_port=${FLEET_PORT:-18444}
mqtt_port=${MQTT_PORT:-11883}

missing() {
  echo "$1 is missing; on Debian: apt-get install $2" >&2
  exit 2
}
command -v nats-server >/dev/null || missing nats-server nats-server
command -v mosquitto >/dev/null || missing mosquitto mosquitto
command -v mosquitto_sub >/dev/null || missing mosquitto_sub mosquitto-clients
programs=$(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -V | tail -1)
[ -n "$programs" ] && [ -x "$programs/postgres" ] || missing PostgreSQL postgresql

started=''
end() {
  trap - EXIT INT TERM
  for id in $started; do kill "$id" 2>/dev/null || true; done
  wait 2>/dev/null || true
}
trap end EXIT
trap 'exit 130' INT TERM

# PostgreSQL refuses to run as root.
as_user=''
if [ "$(id -u)" = 0 ]; then
  as_user='setpriv --reuid=postgres --regid=postgres --clear-groups --'
fi

wait_for() {
  tries=0
  until "$@" >/dev/null 2>&1; do
    tries=$((tries + 1))
    [ "$tries" -lt 300 ] || { echo "waited in vain for: $*" >&2; exit 1; }
    sleep 0.2
  done
}

echo "brokers and database"
mosquitto -p "$mqtt_port" >"$folder/mosquitto.log" 2>&1 &
started="$started $!"
wait_for mosquitto_pub -h 127.0.0.1 -p "$mqtt_port" -t ready -n
mosquitto_sub -h 127.0.0.1 -p "$mqtt_port" -t 'spBv1.0/plant/#' -F '%t, %l bytes' >"$folder/sparkplug.log" &
started="$started $!"
nats-server -js -a 127.0.0.1 -p "$broker_port" -sd "$folder/nats" >"$folder/nats.log" 2>&1 &
started="$started $!"
mkdir -p "$folder/postgres"
[ -z "$as_user" ] || { chown postgres "$folder/postgres"; chmod 755 "$folder"; }
[ -f "$folder/postgres/PG_VERSION" ] ||
  $as_user "$programs/initdb" -D "$folder/postgres" -U panelprep --auth=trust -E UTF8 >"$folder/initdb.log" 2>&1
$as_user "$programs/postgres" -D "$folder/postgres" -p "$database_port" -k '' -c listen_addresses=127.0.0.1 >"$folder/postgres.log" 2>&1 &
started="$started $!"
wait_for "$programs/pg_isready" -h 127.0.0.1 -p "$database_port"
"$programs/createdb" -h 127.0.0.1 -p "$database_port" -U panelprep panelprep 2>/dev/null || true

echo "archive and the office's page"
cat >"$folder/archive.toml" <<SETTINGS
files = "files"
[broker]
address = "nats://127.0.0.1:$broker_port"
waiting_gb = 1
[database]
port = $database_port
[fleet]
listen = "127.0.0.1:$fleet_port"
SETTINGS
"$program" archive run --settings "$folder/archive.toml" 2>"$folder/archive.log" >/dev/null &
started="$started $!"
echo 'demonstration' | "$program" archive account office --printed-name 'Office' --settings "$folder/archive.toml" >/dev/null
"$program" fleet --settings "$folder/archive.toml" 2>"$folder/fleet.log" >/dev/null &
started="$started $!"

for cell in 1 2; do
  here="$folder/cell-$cell"
  file="$here/cell.toml"
  if [ ! -f "$file" ]; then
    echo "cell-$cell: a simulated cell is written and its panel is taught"
    "$program" render --seed "$cell" --reduction 4 --out "$here" >"$folder/cell-$cell.log" 2>&1
    "$program" teach --cell "$file" --recipe "$here/recipe.toml" --scan "$here/taught_scan.pcd" --corner "$here/taught_corner.png" \
      --flange "$here/taught_flange.json" >>"$folder/cell-$cell.log" 2>&1
    for camera in scanner flange_camera; do
      flange=''
      [ "$camera" = scanner ] || flange="--flange $here/target/flange.json"
      # shellcheck disable=SC2086
      "$program" calibrate verify --cell "$file" --camera "$(echo $camera | tr _ -)" --board 5x4 --square-mm 40 \
        --target "$here/target/$camera.toml" --image "$here/target/$camera.png" $flange >>"$folder/cell-$cell.log" 2>&1
    done
    cat >>"$file" <<SETTINGS

[office]
broker = "nats://127.0.0.1:$broker_port"
cell = "cell-$cell"

[sparkplug]
broker = "127.0.0.1"
port = $mqtt_port
group_id = "plant"
edge_node_id = "cell-$cell"
SETTINGS
  fi
  "$program" run --cell "$file" --seed "$cell" 2>>"$folder/cell-$cell.log" >/dev/null &
  started="$started $!"
done

for cell in 1 2; do
  file="$folder/cell-$cell/cell.toml"
  wait_for "$program" ctl state --cell "$file"
  # The robot may not be connected yet.
  wait_for "$program" ctl reset --wait --cell "$file"
  echo "cell-$cell: one cycle"
  "$program" ctl start --recipe "$folder/cell-$cell/recipe.toml" --part "SN-$cell-$(date +%H%M%S)" --wait --cell "$file" | tail -1 | sed "s/^/cell-$cell: /"
done

echo "proof: does the archive hold the same as both cells?"
wait_for "$program" archive check --settings "$folder/archive.toml" "cell-1=$folder/cell-1/store" "cell-2=$folder/cell-2/store"
"$program" archive check --settings "$folder/archive.toml" "cell-1=$folder/cell-1/store" "cell-2=$folder/cell-2/store"

echo "MQTT Sparkplug: what a host application has heard"
for cell in 1 2; do
  for kind in NBIRTH NDATA; do
    echo "cell-$cell: $(grep -c "^spBv1.0/plant/$kind/cell-$cell," "$folder/sparkplug.log") messages $kind"
  done
done

[ -z "${ONCE:-}" ] || exit 0
echo
echo "The office's page: http://127.0.0.1:$fleet_port/ (account office, password demonstration). Ctrl-C ends everything."
wait
