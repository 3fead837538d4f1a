//! The three devices: requests in, answers out, over connections on loopback. A client copies them from and to palpate.

use crate::world::{World, WorldCommand};
use std::io::{self, BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Longest time that `prepare` takes.
const PREPARE_DEADLINE: Duration = Duration::from_secs(60);

/// Interval of looks at axes that must rest.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// What is answered later than at once is written by a thread of its own.
type Writer = Arc<Mutex<TcpStream>>;

pub(crate) type WorldShared = Arc<Mutex<World>>;

/// The world, moved up to now.
pub(crate) fn now(world: &WorldShared) -> MutexGuard<'_, World> {
    let mut world = world.lock().unwrap_or_else(PoisonError::into_inner);
    world.advance();
    world
}

/// Serves every client that connects, until the program ends.
pub(crate) fn serve(world: &WorldShared) -> io::Result<u16> {
    let listener = TcpListener::bind(("127.0.0.1", 0))?;
    let port = listener.local_addr()?.port();
    let world = world.clone();
    thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let world = world.clone();
            thread::spawn(move || attend(&world, stream));
        }
    });
    Ok(port)
}

/// Copies between palpate and the world, as the program that palpate starts.
pub(crate) fn client(role: &str, port: u16) -> io::Result<()> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_nodelay(true)?;
    writeln!(stream, "{role}")?;
    let answers = BufReader::new(stream.try_clone()?);
    // the end of the input ends the connection
    thread::spawn(move || {
        for line in io::stdin().lines().map_while(Result::ok) {
            if writeln!(stream, "{line}").is_err() {
                break;
            }
        }
        let _ = stream.shutdown(Shutdown::Write);
    });
    let mut said = io::stdout();
    answers.lines().try_for_each(|line| writeln!(said, "{}", line?))
}

fn attend(world: &WorldShared, stream: TcpStream) -> Option<()> {
    stream.set_nodelay(true).ok()?;
    let writer: Writer = Arc::new(Mutex::new(stream.try_clone().ok()?));
    let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
    let role = lines.next()?;
    for line in lines {
        // a dead device doesn't receive either
        if answer(world, &writer, &role, &line).is_none() {
            break;
        }
    }
    writer.lock().unwrap_or_else(PoisonError::into_inner).shutdown(Shutdown::Both).ok()
}

/// Acts on a request and answers; none if the device has ended.
fn answer(world: &WorldShared, writer: &Writer, role: &str, line: &str) -> Option<()> {
    let class = if role == "load_cell" { "cell" } else { role };
    let mut state = now(world);
    if state.fault(&format!("{class}-dead")).is_some() {
        return None;
    }
    let id = number(line, "id").unwrap_or(0.0) as u64;
    let body = match text(line, "do").as_deref() {
        Some("identify") => {
            let units = if role == "array" { format!(", \"units\": {}", state.setting.units()) } else { String::new() };
            format!("\"role\": \"{role}\", \"protocol\": 1, \"identity\": \"spring world\"{units}")
        }
        Some("stop") => {
            state.command(WorldCommand::Stop);
            return Some(());
        }
        Some("speed") => {
            state.command(WorldCommand::Speed(number(line, "speed_mm_s")?));
            return Some(());
        }
        Some("status") => {
            let (moving, at_mm) = state.status();
            let show =
                |mm: f64| if state.fault("stage-nan").is_some() { "null".to_owned() } else { format!("{mm:.5}") };
            let [x, y, z] = at_mm.map(show);
            format!("\"moving\": {moving}, \"position_mm\": {{\"x\": {x}, \"y\": {y}, \"z\": {z}}}")
        }
        Some("move") => moved(&mut state, line),
        Some("prepare") => {
            let travel_mm = ["x", "y", "z"].map(|axis| range(line, axis).unwrap_or([0.0, 0.0]));
            state.prepare(travel_mm, number(line, "acceleration_mm_s2").unwrap_or(100.0));
            let home_mm_s = number(line, "home_speed_mm_s").unwrap_or(1.0);
            state.command(WorldCommand::Move { to_mm: [None, None, Some(travel_mm[2][1])], speed_mm_s: home_mm_s });
            drop(state);
            let (world, writer) = (world.clone(), writer.clone());
            thread::spawn(move || {
                let until = Instant::now() + PREPARE_DEADLINE;
                while !now(&world).rests() && Instant::now() < until {
                    thread::sleep(LOOK_EVERY);
                }
                let home = (now(&world).axes[2].at_mm - travel_mm[2][1]).abs() < 0.001;
                let body = if home { String::new() } else { "\"error\": \"stopped before home\"".to_owned() };
                deliver(&writer, &reply(id, &body));
            });
            return Some(());
        }
        Some("read") if role == "array" => format!("\"outputs\": [{}]", outputs(&mut state)),
        Some("read") => reading(&state),
        _ => "\"error\": \"unknown request\"".to_owned(),
    };
    let spoilt = spoilt(&mut state, class, id, &body);
    drop(state);
    match spoilt {
        (_, lines) if lines.is_empty() => {}
        (None, lines) => deliver(writer, &lines),
        (Some(late), lines) => {
            let writer = writer.clone();
            thread::spawn(move || {
                thread::sleep(late);
                deliver(&writer, &lines);
            });
        }
    }
    Some(())
}

/// An answer as a faulty link delivers it: how late, and which lines.
fn spoilt(state: &mut World, class: &str, id: u64, body: &str) -> (Option<Duration>, String) {
    let has = |state: &World, what: &str| state.fault(&format!("{class}-{what}"));
    let line = reply(id, body);
    let late = has(state, "late").map(Duration::from_secs_f64);
    if has(state, "silent").is_some() {
        return (None, String::new());
    }
    let (now_s, lost) = (state.now_s, format!("{class}-lost"));
    if let Some(fault) =
        state.faults.iter_mut().find(|fault| fault.name == lost && fault.acts(now_s) && fault.value > 0.0)
    {
        fault.value -= 1.0;
        return (None, String::new());
    }
    let line = match () {
        () if has(state, "garbage").is_some() => "\u{fffd}{\"id\": \u{1}\n".to_owned(),
        () if has(state, "wrong-id").is_some() => reply(id + 1000, body),
        () if has(state, "error").is_some() => reply(id, "\"error\": \"amplifier fault 17\""),
        () if has(state, "twice").is_some() => line.repeat(2),
        () => line,
    };
    (late, line)
}

fn moved(state: &mut World, line: &str) -> String {
    let to_mm = line.find("\"to_mm\"").map_or("", |at| &line[at..]);
    let to_mm = &to_mm[..to_mm.find('}').unwrap_or(to_mm.len())];
    let to_mm = ["x", "y", "z"].map(|axis| number(to_mm, axis));
    let Some(travel_mm) = state.travel_mm else { return "\"error\": \"not prepared\"".to_owned() };
    let beyond = |axis: usize| to_mm[axis].is_some_and(|mm| mm < travel_mm[axis][0] || mm > travel_mm[axis][1]);
    match number(line, "speed_mm_s") {
        Some(speed_mm_s) if !(0..3).any(beyond) => {
            state.command(WorldCommand::Move { to_mm, speed_mm_s });
            String::new()
        }
        _ => "\"error\": \"beyond the travel\"".to_owned(),
    }
}

fn reading(state: &World) -> String {
    let says = |name: &str| state.fault(name).is_some();
    let force = match () {
        () if says("cell-nan") => "NaN".to_owned(),
        () if says("cell-inf") => "1e999".to_owned(),
        () if says("cell-null") => "null".to_owned(),
        () if says("cell-text") => "\"OL\"".to_owned(),
        () => format!("{:.6}", state.reading_n),
    };
    let flags = [("cell-flag", ", \"saturated\": true"), ("cell-broken", ", \"fault\": true")];
    let flags: String = flags.iter().filter(|(name, _)| says(name)).map(|(_, text)| *text).collect();
    format!("\"force_n\": {force}{flags}")
}

fn outputs(state: &mut World) -> String {
    let mut outputs: Vec<String> = state.read_outputs().iter().map(|volts| format!("{volts:.6}")).collect();
    if state.fault("array-nan").is_some() {
        outputs[0] = "NaN".to_owned();
    }
    if state.fault("array-short").is_some() {
        outputs.pop();
    }
    outputs.join(", ")
}

fn reply(id: u64, body: &str) -> String {
    let comma = if body.is_empty() { "" } else { ", " };
    format!("{{\"id\": {id}{comma}{body}}}\n")
}

fn deliver(writer: &Writer, lines: &str) {
    // a client that has gone needs no answer
    let _ = writer.lock().unwrap_or_else(PoisonError::into_inner).write_all(lines.as_bytes());
}

/// What follows a key of a request, which is written without nested objects of the same key.
fn after<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    let at = line.find(&format!("\"{key}\":"))?;
    Some(line[at + key.len() + 3..].trim_start())
}

fn number(line: &str, key: &str) -> Option<f64> {
    let rest = after(line, key)?;
    rest[..rest.find([',', '}', ']']).unwrap_or(rest.len())].trim().parse().ok()
}

fn text(line: &str, key: &str) -> Option<String> {
    after(line, key)?.strip_prefix('"')?.split('"').next().map(str::to_owned)
}

fn range(line: &str, key: &str) -> Option<[f64; 2]> {
    let rest = after(line, key)?.strip_prefix('[')?;
    let mut numbers = rest[..rest.find(']')?].split(',').map(|number| number.trim().parse().ok());
    Some([numbers.next()??, numbers.next()??])
}
