//! Table of the results for the terminal.

use super::results::{BenchResults, ChainRatios, ChainSummary};
use hapfic_diagnostics::ChainQuantiles;
use std::fmt::{self, Write};

/// Maximum number of missed ticks in the table; the JSON has all.
const MAX_MISSES: usize = 20;

/// Formats the results.
pub(super) fn text(results: &BenchResults) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_all(&mut out, results);
    out
}

fn write_all(out: &mut String, r: &BenchResults) -> fmt::Result {
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
        "plant/controller/gate: FIFO {}/{}/{} on core {}; the chains' three processes likewise on core {}; \
         messages of {}/{}/{} bytes; {}",
        a.priorities[0],
        a.priorities[1],
        a.priorities[2],
        list(named(a.on_cores)),
        list(named(a.chains_on_cores)),
        a.message_bytes[0],
        a.message_bytes[1],
        a.message_bytes[2],
        if a.load == 0 { format!("load average {:.2} before", a.load_average) } else { format!("{} busy processes", a.load) }
    )?;
    if !r.completed {
        writeln!(out, "THE RUN DID NOT COMPLETE; the results are incomplete")?;
    }
    let heads = ["count", "p50", "p99", "p99.9", "p99.99", "max us"];
    write!(out, "\n{:<36}", "the stack's chain, hop by hop")?;
    heads.iter().try_for_each(|head| write!(out, " {head:>9}"))?;
    writeln!(out)?;
    for hop in &r.hops_us {
        row(out, hop.part.name(), &hop.quantiles)?;
    }
    row(out, "state published -> command received", &r.published_us)?;
    writeln!(out, "\ninterleaved three-hop round trips, from before sending to the answer")?;
    row(out, "THE STACK, with its work", &r.stack_us)?;
    for chain in &r.chains {
        row(out, &chain.name, &chain.round_us)?;
    }
    writeln!(out, "\nlateness of a timer at the plant's priority")?;
    row(out, "timer", &r.timer_us)?;
    writeln!(out)?;
    for ChainRatios { name, p50, p999 } in &r.ratios {
        let format = |ratio: &Option<hapfic_diagnostics::Ratio>| ratio.map_or("unknown".to_owned(), |ratio| ratio.to_string());
        writeln!(out, "the stack over {name:<14} p50 {:<40} p99.9 {}", format(p50), format(p999))?;
    }
    write_missed(out, r)?;
    for ChainSummary { name, unanswered, skipped, .. } in r.chains.iter().filter(|c| c.unanswered + c.skipped > 0) {
        writeln!(out, "{name}: {unanswered} messages without an answer in 5 ms, {skipped} not sent after a long round trip")?;
    }
    writeln!(
        out,
        "{} commands after the plant's wait; {} allocations in real-time code; {} ms steal time",
        r.late, r.allocations, r.stolen_ms
    )?;
    if !r.not_granted.is_empty() {
        writeln!(out, "NOT GRANTED, so these results are not those of a real-time machine:")?;
        r.not_granted.iter().try_for_each(|what| writeln!(out, "  {what}"))?;
    }
    Ok(())
}

fn write_missed(out: &mut String, r: &BenchResults) -> fmt::Result {
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
    m.list.iter().take(MAX_MISSES).try_for_each(|diagnosis| writeln!(out, "  {diagnosis}"))?;
    match m.list.len().saturating_sub(MAX_MISSES) {
        0 => Ok(()),
        more => writeln!(out, "  and {more} more"),
    }
}

fn row(out: &mut String, name: &str, q: &ChainQuantiles) -> fmt::Result {
    write!(out, "  {name:<34} {:>9}", q.count)?;
    for value in [q.p50, q.p99, q.p999, q.p9999, q.max] {
        // Too few durations for this quantile.
        write!(out, " {:>9}", value.map_or("-".to_owned(), |us| format!("{us:.1}")))?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::sample_results;
    use super::*;

    #[test]
    fn text_sample_results_has_all_lines() {
        let mut results = sample_results();
        results.not_granted.push("futex, process 1: not FIFO".to_owned());
        let text = text(&results);
        for line in [
            "floor: 1 s measured after a warm-up, 1000 ticks; Linux 6.1, 2 cores",
            "  THE STACK, with its work                1000      60.0      60.0      60.0         -      60.0",
            "missed deadlines: 1 in 1000 ticks, 100.0 in 100 000; cause: steal 0, machine 1, stack 0, not known 0",
            "  tick 0 unanswered: machine (reference timer 900 us late, 0 ms steal time, plant's timer 0 us late, \
             no process published)",
            "futex: 1 messages without an answer in 5 ms, 1 not sent after a long round trip",
            "  futex, process 1: not FIFO",
        ] {
            assert!(text.lines().any(|l| l == line), "'{line}' is not in\n{text}");
        }
        assert!(
            text.contains(
                "FIFO 80/76/78 on core 1/1/0; the chains' three processes likewise on core 1; messages of 8/16/24 bytes"
            )
        );
        let ratio = "p50 1.20 x (1.20 to 1.20 over ten segments)";
        assert!(text.lines().any(|l| l.starts_with("the stack over futex") && l.contains(ratio)));
    }
}
