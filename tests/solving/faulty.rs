use palpate_core::quantity::{ArrayLayout, Place, stream};
use palpate_data::dataset::{Mapping, read_table};
use palpate_sim::scene::{Skin, NoiseOf, SkinSpec, TaxelNoise, Elastomer};
use palpate_solver::*;
use rand::RngExt;
use std::time::Instant;

type Row = (Place, f64, Vec<f64>);
struct S { name: String, cal: Vec<Row>, forces: bool, test: Vec<Row>, layout: Option<ArrayLayout>, quiet: Vec<f64> }

fn sim(rows: usize, cols: usize, step: f64, seed: u64) -> S {
    let layout = ArrayLayout::grid(rows, cols, 4.5);
    let spec = SkinSpec {
        elastomer: Some(Elastomer::half_space(5.0)),
        noise: Some(TaxelNoise { repeatability_percent: vec![1.0; rows*cols], of: NoiseOf::Reading, floor: 0.001 }),
        ..SkinSpec::default()
    };
    let spec = if rows * cols == 9 { palpate_testing::skins::scene_t() } else { spec };
    let mut skin = Skin::new(&spec, &layout, 2.0, seed);
    let mut rng = stream(seed, 1, "x");
    let mut read = |f: f64, p: Place, rng: &mut _| { let mut o = vec![0.0; skin.len()]; skin.draw_contact(rng); skin.outputs(f, p, &mut o); o };
    let (hx, hy) = (4.5 * (cols as f64 - 1.0) / 2.0 + 1.5, 4.5 * (rows as f64 - 1.0) / 2.0 + 1.5);
    let (nx, ny) = ((2.0*hx/step) as usize + 1, (2.0*hy/step) as usize + 1);
    let mut cal = Vec::new();
    for i in 0..nx { for j in 0..ny { let p = Place::new(-hx + step*i as f64, -hy + step*j as f64); cal.push((p, 1.0, read(1.0, p, &mut rng))); } }
    let test = (0..2000).map(|_| { let p = Place::new(rng.random_range(-hx..hx), rng.random_range(-hy..hy)); let f = rng.random_range(0.1..1.0); (p, f, read(f, p, &mut rng)) }).collect();
    let still: Vec<Vec<f64>> = (0..200).map(|_| read(0.0, Place::new(0.0, 0.0), &mut rng)).collect();
    let quiet = (0..rows*cols).map(|u| (still.iter().map(|o| o[u]*o[u]).sum::<f64>() / 200.0).sqrt()).collect();
    S { name: format!("sim{}", rows*cols), cal, forces: true, test, layout: Some(layout), quiet }
}
fn rows(path: &str) -> Vec<Row> {
    read_table(std::path::Path::new(path), &Mapping::default()).unwrap().presses.iter().map(|p| (p.place(), p.force_n.unwrap_or(1.0), p.outputs.clone())).collect()
}
fn shuffled(mut v: Vec<Row>, n: usize) -> Vec<Row> {
    let mut rng = stream(3, 0, "s");
    for i in 0..v.len() { let j = rng.random_range(i..v.len()); v.swap(i, j); }
    v.truncate(n); v
}
fn scene(name: &str) -> S {
    let d = "/tmp/shared/data";
    match name {
        "eflesh-other" => {
            let cal = rows(&format!("{d}/eflesh/fixed_depth.csv"));
            let cal: Vec<Row> = cal[..961].to_vec().into_iter().filter(|r| (r.0.x_mm.round() as i64 + r.0.y_mm.round() as i64) % 2 == 0).collect();
            S { name: name.into(), cal, forces: false, test: shuffled(rows(&format!("{d}/eflesh/random_depth.csv")), 4000), layout: None, quiet: vec![] }
        }
        "eflesh-back" => {
            let cal = rows(&format!("{d}/eflesh/random_depth.csv"));
            let cal: Vec<Row> = cal.into_iter().take(3 * 961).filter(|r| (r.0.x_mm.round() as i64 + r.0.y_mm.round() as i64) % 2 == 0).collect();
            S { name: name.into(), cal, forces: false, test: shuffled(rows(&format!("{d}/eflesh/fixed_depth.csv")), 4000), layout: None, quiet: vec![] }
        }
        "eflesh-same" => {
            let all = rows(&format!("{d}/eflesh/random_depth.csv"));
            let cal = all[..3*961].iter().filter(|r| (r.0.x_mm.round() as i64 + r.0.y_mm.round() as i64) % 2 == 0).cloned().collect();
            S { name: name.into(), cal, forces: false, test: shuffled(all[3*961..].to_vec(), 1000), layout: None, quiet: vec![] }
        }
        "eflesh-fixed" => {
            let all = rows(&format!("{d}/eflesh/fixed_depth.csv"));
            let cal = all[..961].iter().filter(|r| (r.0.x_mm.round() as i64 + r.0.y_mm.round() as i64) % 2 == 0).cloned().collect();
            S { name: name.into(), cal, forces: false, test: shuffled(all[3*961..].to_vec(), 1000), layout: None, quiet: vec![] }
        }
        "sdu" => {
            let all = rows(&format!("{d}/sdu/pad_2d.csv"));
            let is = |r: &&Row| [r.0.x_mm, r.0.y_mm].iter().all(|mm| (mm / 2.0).round() as i64 % 2 == 0);
            S { name: name.into(), cal: all.iter().filter(is).cloned().collect(), forces: true, test: shuffled(all.iter().filter(|r| !is(r)).cloned().collect(), 4000), layout: None, quiet: vec![] }
        }
        "sim9" => sim(3,3,1.5,7), "sim16" => sim(4,4,1.5,8), "sim36" => sim(6,6,2.0,9), "sim100" => sim(10,10,3.0,10), "sim192" => sim(12,16,3.0,11),
        _ => panic!(),
    }
}


#[test]
#[ignore]
fn experiment() {
    let names = std::env::var("SC").unwrap();
    let (mut right, mut all) = (0, 0);
    for name in names.split(',') {
    let s = scene(name);
    let pts: Vec<_> = s.cal.iter().map(|(p, f, o)| CalibrationPoint { place: *p, force_n: *f, outputs: o }).collect();
    let mut cal = Calibration::new(&pts).unwrap();
    if !s.forces { cal = cal.with_unknown_forces(); }
    let layout = if std::env::var("NOLAYOUT").is_ok() { None } else { s.layout.as_ref() };
    let model = Model::fit(&std::env::var("METHOD").unwrap_or("best".into()), cal, &Setting::of_layout(layout)).unwrap();
    println!("== {}: {} units, {} presses, method {}", s.name, model.validity().units, s.cal.len(), model.fitted().name());
    let n = model.validity().units;
    let fits = std::sync::Arc::new(Fits::new(model));
    let stats = |unit: usize| { let m = s.test.iter().map(|r| r.2[unit]).sum::<f64>() / s.test.len() as f64; s.test.iter().map(|r| (r.2[unit]-m).powi(2)).sum::<f64>() };
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| stats(*b).total_cmp(&stats(*a)));
    let (strong, median) = (order[0], order[n/2]);
    let v = [s.test[5].2[strong], s.test[5].2[median]];
    let kinds: Vec<(&str, Vec<usize>, Box<dyn Fn(&mut Vec<f64>)>)> = vec![
        ("clean", vec![], Box::new(|_: &mut Vec<f64>| {})),
        ("strong dead", vec![strong], Box::new(move |o| o[strong] = 0.0)),
        ("strong x.3", vec![strong], Box::new(move |o| o[strong] *= 0.3)),
        ("strong stuck", vec![strong], Box::new(move |o| o[strong] = v[0])),
        ("median dead", vec![median], Box::new(move |o| o[median] = 0.0)),
        ("median x.3", vec![median], Box::new(move |o| o[median] *= 0.3)),
        ("median stuck", vec![median], Box::new(move |o| o[median] = v[1])),
        ("swapped", vec![strong.min(median), strong.max(median)], Box::new(move |o| o.swap(strong, median))),
    ];
    for (kind, units, f) in &kinds {
        if std::env::var("CLEAN").is_ok() != units.is_empty() { continue; }
        let t = Instant::now();
        let streams = if units.is_empty() { (s.test.len() / 1000).max(1) } else { 3 };
        let mut line = String::new();
        for stream in 0..streams {
            let mut session = Session::sharing(fits.clone());
            let (mut felt, mut named, mut seen) = (0, None, 0);
            let mut worst = 0.0f64;
            let (mut after, mut count, mut clean) = (0.0, 0, 0.0);
            let mut w = Workspace::default();
            let fresh = Session::sharing(fits.clone());
            for (i, row) in s.test.iter().cycle().skip(stream * if units.is_empty() { 1000 } else { 333 }).take(1000).enumerate() {
                let mut o = row.2.clone();
                f(&mut o);
                if units.iter().any(|u| row.2[*u].abs() > s.quiet.get(*u).map_or(0.0, |q| 5.0 * q)) { felt += 1; }
                let t = Instant::now();
                let solved = session.solve(&o);
                worst = worst.max(t.elapsed().as_secs_f64());
                if session.changes().len() > seen {
                    line += &format!(" [{i} felt {felt}: {:?}]", session.changes()[seen..].iter().map(|c| match c { FaultChange::LeftOut(FaultyUnit { unit, odds }) => format!("{unit} {:.0}", odds.ln()), FaultChange::Back(unit) => format!("back {unit}"), FaultChange::Unfit => "unfit".into() }).collect::<Vec<_>>());
                    seen = session.changes().len();
                }
                let mut out: Vec<usize> = session.broken().iter().map(|b| b.unit).collect();
                out.sort();
                if !units.is_empty() && out == *units && named.is_none() { named = Some(felt); }
                if named.is_some() && let Ok(sol) = solved { after += sol.place.distance_mm(row.0); count += 1; }
                if let Ok(sol) = fresh.model().fitted().solve(&row.2, &mut w) { clean += sol.place.distance_mm(row.0) / 1000.0; }
                if named.is_some() && count >= 200 { break; }
            }
            if !units.is_empty() { all += 1; if named.is_some_and(|f| f <= 60) { right += 1; } } 
            line += &format!(" {named:?} {:.2}/{clean:.2} mm;", after / count as f64);
        }
        println!("{kind:13} {units:?}: {line} ({:.1} s)", t.elapsed().as_secs_f64());
    }
    }
    println!("named within 60: {right} of {all}");
}
