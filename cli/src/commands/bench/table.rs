//! The results of a measurement as text.

use super::results::{Against, Chain, Results};
use hapfic_diagnostics::ChainQuantiles;
use std::fmt::{self, Write};

/// Missed ticks that are shown; all of them are in the JSON.
const MOST_SHOWN: usize = 20;

/// For the terminal.
pub(super) fn text(results: &Results) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_all(&mut out, results);
    out
}

fn write_all(out: &mut String, r: &Results) -> fmt::Result {
    let a = &r.about;
    let named = |cores: [Option<u32>; 3]| cores.map(|core| core.map_or("any".to_owned(), |core| core.to_string()));
    let list = |names: [String; 3]| {
        if names.iter().all(|name| *name == names[0]) { names[0].clone() } else { names.join("/") }
    };
    writeln!(
        out,
        "{}: {} s measured after a warm-up, {} ticks; {}, {} cores",
        a.scenario, a.seconds, r.ticks, a.kernel, a.cores
    )?;
    writeln!(
        out,
        "plant/controller/gate: FIFO {}/{}/{} on core {}; the chains' three processes likewise on core {}; messages of {}/{}/{} bytes; {}",
        a.priorities[0],
        a.priorities[1],
        a.priorities[2],
        list(named(a.on_cores)),
        list(named(a.chains_on_cores)),
        a.message_bytes[0],
        a.message_bytes[1],
        a.message_bytes[2],
        if a.load == 0 { "no load beside it".to_owned() } else { format!("{} busy processes beside it", a.load) }
    )?;
    if !r.completed {
        writeln!(out, "THE RUN DID NOT COMPLETE; the figures are of what it did")?;
    }
    let heads = ["count", "p50", "p99", "p99.9", "p99.99", "max us"];
    write!(out, "\n{:<36}", "the stack's chain, hop by hop")?;
    heads.iter().try_for_each(|head| write!(out, " {head:>9}"))?;
    writeln!(out)?;
    for hop in &r.hops_us {
        row(out, hop.part.name(), &hop.quantiles)?;
    }
    row(out, "state published -> command received", &r.published_us)?;
    writeln!(out, "\nthree hops, from before sending to the answer, in the same milliseconds")?;
    row(out, "THE STACK, with its work", &r.stack_us)?;
    for chain in &r.chains {
        row(out, &chain.name, &chain.round_us)?;
    }
    writeln!(out, "\nhow late a timer at the plant's priority is")?;
    row(out, "timer", &r.timer_us)?;
    writeln!(out)?;
    for Against { name, p50, p999 } in &r.ratios {
        let say = |ratio: &Option<hapfic_diagnostics::Ratio>| ratio.map_or("not known".to_owned(), |ratio| ratio.to_string());
        writeln!(out, "the stack over {name:<14} p50 {:<40} p99.9 {}", say(p50), say(p999))?;
    }
    write_missed(out, r)?;
    for Chain { name, unanswered, skipped, .. } in r.chains.iter().filter(|c| c.unanswered + c.skipped > 0) {
        writeln!(
            out,
            "{name}: {unanswered} messages without an answer in 5 ms, {skipped} not sent, the one before taking so long"
        )?;
    }
    writeln!(
        out,
        "{} commands came after the plant had stopped waiting; {} allocations in real-time code; {} ms stolen by the host",
        r.late, r.allocations, r.stolen_ms
    )?;
    if !r.not_granted.is_empty() {
        writeln!(out, "NOT GRANTED, so these figures are not those of a real-time machine:")?;
        r.not_granted.iter().try_for_each(|what| writeln!(out, "  {what}"))?;
    }
    Ok(())
}

fn write_missed(out: &mut String, r: &Results) -> fmt::Result {
    let m = &r.missed;
    let causes: Vec<_> = m.causes.iter().map(|(cause, count)| format!("{} {count}", cause.name())).collect();
    writeln!(
        out,
        "\nmissed deadlines: {} in {} ticks, {:.1} in 100 000; cause: {}",
        m.count,
        r.ticks,
        m.per_100_000,
        causes.join(", ")
    )?;
    m.list.iter().take(MOST_SHOWN).try_for_each(|verdict| writeln!(out, "  {verdict}"))?;
    match m.list.len().saturating_sub(MOST_SHOWN) {
        0 => Ok(()),
        more => writeln!(out, "  and {more} more"),
    }
}

fn row(out: &mut String, name: &str, q: &ChainQuantiles) -> fmt::Result {
    write!(out, "  {name:<34} {:>9}", q.count)?;
    for value in [q.p50, q.p99, q.p999, q.p9999, q.max] {
        // Not told by so few.
        write!(out, " {:>9}", value.map_or("-".to_owned(), |us| format!("{us:.1}")))?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::sample_results;
    use super::*;

    #[test]
    fn the_table_says_what_was_found() {
        let mut results = sample_results();
        results.not_granted.push("futex, place 1: not FIFO".to_owned());
        let text = text(&results);
        for line in [
            "floor: 1 s measured after a warm-up, 1000 ticks; Linux 6.1, 2 cores",
            "  THE STACK, with its work                1000      60.0      60.0      60.0         -      60.0",
            "missed deadlines: 1 in 1000 ticks, 100.0 in 100 000; cause: host 1, ours 0, unexplained 0",
            "  tick 0 unanswered: host (witness 900 us late, 0 ms stolen, plant's timer 0 us late, nobody published)",
            "futex: 1 messages without an answer in 5 ms, 1 not sent, the one before taking so long",
            "  futex, place 1: not FIFO",
        ] {
            assert!(text.lines().any(|l| l == line), "'{line}' is not in\n{text}");
        }
        assert!(
            text.contains(
                "FIFO 80/76/78 on core 1/1/0; the chains' three processes likewise on core 1; messages of 8/16/24 bytes"
            )
        );
        assert!(
            text.lines().any(|l| l.starts_with("the stack over futex") && l.contains("p50 1.20 x (1.20 to 1.20 in ten parts)"))
        );
    }
}
