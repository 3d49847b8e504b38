# Source this file for: run_parallel FOLDER NAME...
# Calls the functions of these names at once, with the output of each in FOLDER/NAME.log, then prints it.
# Fails if one of them failed.
run_parallel() {
    local folder=$1 name failed=
    local -A runs
    shift
    mkdir -p "$folder"
    for name; do
        "$name" >"$folder/$name.log" 2>&1 &
        runs[$name]=$!
    done
    for name; do
        wait "${runs[$name]}" || failed+=" $name"
        echo "== $name"
        cat "$folder/$name.log"
    done
    [ -z "$failed" ] || { echo "failed:$failed" >&2; return 1; }
}
