//! What a link opens: one text for every name of one device, so that two names of a device are one claim.

use super::Link;
use std::ffi::OsStr;
use std::fs;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::path::Path;

/// Names of hosts that this machine knows without a network.
#[cfg(unix)]
const HOSTS: &str = "/etc/hosts";

/// Returns what a link opens. `None` if the link isn't real, or if another program may have it too: NI's devices are claimed by
/// their channels, and a program is started for each run and opens its own device.
pub(super) fn opened(link: &Link) -> Option<String> {
    match link {
        Link::Sim | Link::Emulated(_) | Link::Daqmx(_) | Link::Process(_) => None,
        Link::Serial { port, .. } => Some(format!("serial {}", serial_device(port))),
        Link::Tcp { host, port } => Some(format!("tcp {} {port}", address(host, &hosts()))),
        Link::Udp { host, port } => Some(format!("udp {} {port}", address(host, &hosts()))),
    }
}

/// Returns what a command starts: its program, and its arguments with the files that they name. A script in this folder isn't the
/// script of the same name in another one. A script that is named by its whole path is the same from every folder.
pub(super) fn started(command: &[String], search: Option<&OsStr>) -> String {
    let (program, arguments) = command.split_first().map_or(("", command), |(first, rest)| (first.as_str(), rest));
    let argument = |word: &String| match word.split_once('=') {
        // such as --config=stage.toml
        Some((key, value)) if real_path(word).is_none() => {
            format!("{key}={}", real_path(value).as_deref().unwrap_or(value))
        }
        _ => real_path(word).unwrap_or_else(|| word.clone()),
    };
    let words: Vec<String> =
        [found_program(program, search)].into_iter().chain(arguments.iter().map(argument)).collect();
    format!("program {words:?}")
}

/// Returns the NI device of an identity.
pub(super) fn ni_device(device: &str) -> String {
    format!("daqmx {}", device.to_lowercase())
}

/// Returns the devices of physical channels, such as `Dev1` of `Dev1/ai0:8`.
pub(super) fn ni_devices(physical: &str) -> impl Iterator<Item = &str> {
    physical.split(',').map(|channel| {
        let channel = channel.trim().trim_start_matches('/');
        channel.split_once('/').map_or(channel, |(device, _)| device)
    })
}

/// Returns the file of a program. A name without a folder is searched for, as the system does.
fn found_program(program: &str, search: Option<&OsStr>) -> String {
    let has_folder = Path::new(program).components().count() > 1 || program.contains(std::path::is_separator);
    let found = if has_folder {
        real_path(program)
    } else {
        let file = |folder: std::path::PathBuf| {
            let names = [program.to_owned(), format!("{program}{}", std::env::consts::EXE_SUFFIX)];
            names.iter().map(|name| folder.join(name)).find(|path| path.is_file())
        };
        search
            .and_then(|search| std::env::split_paths(search).find_map(file))
            .and_then(|path| real_path(path.to_str()?))
    };
    found.unwrap_or_else(|| program.to_owned())
}

/// Returns one text for all names of a host that this machine knows without a network. A name that only a network knows stays a
/// name.
fn address(host: &str, hosts: &str) -> String {
    let name = host.trim_end_matches('.').to_lowercase();
    let listed = || address_in(hosts, &name);
    match name.parse().ok().or_else(listed).map(|address: IpAddr| address.to_canonical()) {
        _ if name == "localhost" => "loopback".to_owned(),
        // `localhost` may be either
        Some(address) if address == Ipv4Addr::LOCALHOST || address == Ipv6Addr::LOCALHOST => "loopback".to_owned(),
        Some(address) => address.to_string(),
        None => name,
    }
}

/// Returns the first address of a name in the text of a hosts file.
fn address_in(hosts: &str, name: &str) -> Option<IpAddr> {
    hosts.lines().find_map(|line| {
        let mut words = line.split('#').next()?.split_whitespace();
        let address = words.next()?.parse().ok()?;
        words.any(|word| word.eq_ignore_ascii_case(name)).then_some(address)
    })
}

/// Returns the text of the hosts file; an empty one if there is none.
fn hosts() -> String {
    #[cfg(unix)]
    let text = fs::read_to_string(HOSTS).unwrap_or_default();
    #[cfg(not(unix))]
    let text = String::new(); // its place isn't fixed there
    text
}

fn serial_device(port: &str) -> String {
    #[cfg(target_os = "linux")]
    {
        use std::os::linux::fs::MetadataExt;
        use std::os::unix::fs::FileTypeExt;
        // every name of a device has its number, also in a container that mounts it elsewhere
        if let Some(found) = fs::metadata(port).ok().filter(|found| found.file_type().is_char_device()) {
            return format!("device {}", found.st_rdev());
        }
    }
    let path = real_path(port).unwrap_or_else(|| port.to_owned());
    match path.strip_prefix("/dev/tty.") {
        Some(name) if cfg!(target_os = "macos") => format!("/dev/cu.{name}"), // both have the same link
        _ if cfg!(windows) => path.trim_start_matches(r"\\.\").to_uppercase(), // COM10 has both names
        _ => path,
    }
}

/// Returns the file to which all links of a path lead.
fn real_path(path: &str) -> Option<String> {
    Some(fs::canonicalize(path).ok()?.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOSTS_FILE: &str = "127.0.0.1 localhost # this machine\n# 10.0.0.9 xps\n10.0.0.5\txps.lab  XPS\nnonsense\n";

    fn link(text: &str) -> Option<String> {
        opened(&Link::parse(text).unwrap())
    }

    fn command(words: &[&str], search: &Path) -> String {
        started(&words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>(), Some(search.as_os_str()))
    }

    #[test]
    fn links_that_programs_share_are_not_claimed() {
        let program = Link::Process(vec!["python3".to_owned(), "temperature.py".to_owned()]);
        for link in [Link::Sim, Link::Daqmx(None), program] {
            assert_eq!(opened(&link), None, "{link}");
        }
    }

    #[test]
    fn address_is_the_same_in_every_notation() {
        for (one, other) in [
            ("tcp://Stage.Local:1", "tcp://stage.local.:1"),
            ("tcp://::1:1", "tcp://0:0:0:0:0:0:0:1:1"),
            ("tcp://::ffff:10.0.0.5:1", "tcp://10.0.0.5:1"),
            ("tcp://localhost:5001", "tcp://127.0.0.1:5001"),
            ("tcp://LOCALHOST:5001", "tcp://::1:5001"),
            ("udp://Cell:1", "udp://cell:1"),
        ] {
            assert_eq!(link(one), link(other), "{one}");
        }
        for (one, other) in
            [("tcp://a:1", "tcp://a:2"), ("tcp://a:1", "udp://a:1"), ("tcp://127.0.0.1:1", "tcp://127.0.0.2:1")]
        {
            assert_ne!(link(one), link(other), "{one}");
        }
    }

    #[test]
    fn name_in_the_hosts_file_is_its_address() {
        for name in ["xps", "XPS", "xps.lab", "10.0.0.5"] {
            assert_eq!(address(name, HOSTS_FILE), "10.0.0.5", "{name}");
        }
        assert_eq!(address("esp", HOSTS_FILE), "esp");
        assert_eq!(address("localhost", ""), address("127.0.0.1", ""));
    }

    #[test]
    fn device_is_named_without_its_settings() {
        assert_eq!(link("serial://COM3?baud=9600"), link("serial://COM3?baud=1200&parity=even"));
        assert_eq!(ni_devices("Dev1/ai0:3, /cDAQ1Mod2/ai1").collect::<Vec<_>>(), ["Dev1", "cDAQ1Mod2"]);
        assert_eq!(ni_device("Dev1"), ni_device("dev1"));
    }

    #[cfg(unix)]
    #[test]
    fn port_is_the_same_by_every_path() {
        let folder = tempfile::tempdir().unwrap();
        let serial = |path: &Path| link(&format!("serial://{}?baud=9600", path.display()));
        let (by_id, beside) = (folder.path().join("usb-stage"), folder.path().join("usb-cell"));
        std::os::unix::fs::symlink("/dev/null", &by_id).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &beside).unwrap();
        assert_eq!(serial(Path::new("/dev/null")), serial(&by_id));
        assert_ne!(serial(&beside), serial(&by_id));
        // unplugged: its name remains
        let (gone, other) = (folder.path().join("ttyUSB0"), folder.path().join("ttyUSB1"));
        assert_ne!(serial(&gone), serial(&other));
    }

    #[cfg(unix)]
    #[test]
    fn a_command_is_the_files_that_it_names() {
        let bench = tempfile::tempdir().unwrap();
        let path = |name: &str| bench.path().join(name);
        for folder in ["bin", "one", "two"] {
            fs::create_dir(path(folder)).unwrap();
        }
        for file in ["bin/python3", "one/stage.py", "two/stage.py", "one/stage.toml"] {
            fs::write(path(file), "").unwrap();
        }
        std::os::unix::fs::symlink(path("one/stage.py"), path("stage-link")).unwrap();
        let bin = path("bin");
        let [python, one, two, by_link, config] =
            ["bin/python3", "one/stage.py", "two/stage.py", "stage-link", "one/stage.toml"]
                .map(|name| path(name).display().to_string());
        let stage = command(&["python3", &one], &bin);
        assert_eq!(stage, command(&[&python, &by_link], &bin), "the program is searched for, and links are followed");
        assert_ne!(stage, command(&["python3", &two], &bin), "another folder's script of this name");
        assert_ne!(stage, command(&["python3", &one, "COM4"], &bin), "another device of this script");
        let up = format!("--config={}/../one/stage.toml", path("two").display());
        assert_eq!(command(&[&one, &format!("--config={config}")], &bin), command(&[&one, &up], &bin));
        assert_ne!(command(&["a b"], &bin), command(&["a", "b"], &bin));
        assert_eq!(command(&["missing", "-m", "stage"], &bin), r#"program ["missing", "-m", "stage"]"#);
        assert_eq!(command(&[], &bin), r#"program [""]"#);
    }
}
