//! The members of ZIP files, stored or deflated, by the directory at the file's end.

#![cfg_attr(not(feature = "gaussians"), allow(dead_code))]

use crate::error::{Fault, Problem, quote};
use crate::files::{most_unpacked, most_unpacked_in_words};
use flate2::read::DeflateDecoder;
use std::borrow::Cow;
use std::io::Read;

/// Most bytes that deflate makes of one.
const DEFLATE_EXPANSION: u64 = 1032;
/// A ZIP file's directory.
pub(crate) struct Archive<'a> {
    bytes: &'a [u8],
    members: Vec<Member<'a>>,
    /// Bytes that may still be unpacked.
    budget: u64,
}

#[derive(Clone, Copy)]
struct Member<'a> {
    name: &'a [u8],
    method: u16,
    encrypted: bool,
    packed: u64,
    whole: u64,
    /// Where its local header begins.
    start: u64,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn damaged(what: impl Into<String>) -> Fault {
    Problem::new(what).help("copy or download the file again: it is incomplete or damaged").into()
}

impl<'a> Archive<'a> {
    pub(crate) fn open(bytes: &'a [u8]) -> Result<Self, Fault> {
        let members = directory(bytes).ok_or_else(|| damaged("the ZIP file has no directory at its end"))?;
        Ok(Self { bytes, members, budget: most_unpacked(bytes.len()) })
    }

    /// Names of the members in the directory's order.
    pub(crate) fn names(&self) -> impl Iterator<Item = Cow<'a, str>> {
        self.members.iter().map(|m| String::from_utf8_lossy(m.name))
    }

    /// The member of this name.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.members.iter().position(|m| m.name == name.as_bytes())
    }

    /// What the member of this index holds.
    pub(crate) fn read(&mut self, index: usize) -> Result<Cow<'a, [u8]>, Fault> {
        let member = self.members.get(index).copied();
        self.unpack(member.ok_or_else(|| damaged("the ZIP file lacks a member"))?)
    }

    fn unpack(&mut self, member: Member<'a>) -> Result<Cow<'a, [u8]>, Fault> {
        let name = quote(member.name);
        let data = data_of(self.bytes, &member).ok_or_else(|| damaged(format!("the ZIP file ends within {name}")))?;
        if member.encrypted {
            return Err(Problem::new(format!("{name} in the ZIP file is encrypted")).help("unpack it first").into());
        }
        match member.method {
            0 => Ok(data.into()),
            8 => {
                let backed = member.whole <= (member.packed + 1).saturating_mul(DEFLATE_EXPANSION);
                if !backed || member.whole > self.budget {
                    let what = format!("{name} in the ZIP file claims to be {} bytes long", member.whole);
                    return Err(Problem::new(what).expected(most_unpacked_in_words()).help("unpack it first").into());
                }
                self.budget -= member.whole;
                let mut content = Vec::new();
                let read = DeflateDecoder::new(data).take(member.whole + 1).read_to_end(&mut content);
                if read.is_err() || content.len() as u64 != member.whole {
                    return Err(damaged(format!("{name} in the ZIP file is damaged")));
                }
                Ok(content.into())
            }
            method => {
                let problem = Problem::new(format!("{name} in the ZIP file is compressed by method {method}"));
                Err(problem.expected("stored (0) or deflated (8)").help("unpack it first").into())
            }
        }
    }
}

/// The bytes of a member, after its local header.
fn data_of<'a>(bytes: &'a [u8], member: &Member<'_>) -> Option<&'a [u8]> {
    let local = bytes.get(usize::try_from(member.start).ok()?..)?;
    if u32_at(local, 0)? != 0x0403_4b50 {
        return None;
    }
    let start = 30 + usize::from(u16_at(local, 26)?) + usize::from(u16_at(local, 28)?);
    local.get(start..)?.get(..usize::try_from(member.packed).ok()?)
}

fn directory(bytes: &[u8]) -> Option<Vec<Member<'_>>> {
    // The end record has 22 bytes and a comment of up to 65535.
    let tail = bytes.len().saturating_sub(22 + 65_535);
    let end = (tail..bytes.len().checked_sub(21)?).rev().find(|&at| u32_at(bytes, at) == Some(0x0605_4b50))?;
    let (mut count, mut start) = (u64::from(u16_at(bytes, end + 10)?), u64::from(u32_at(bytes, end + 16)?));
    if count == 0xffff || start == 0xffff_ffff {
        // ZIP64: a record of 20 bytes before it says where the larger end record is.
        let locator = end.checked_sub(20).filter(|&at| u32_at(bytes, at) == Some(0x0706_4b50));
        if let Some(locator) = locator {
            let larger = usize::try_from(u64_at(bytes, locator + 8)?).ok()?;
            if u32_at(bytes, larger)? != 0x0606_4b50 {
                return None;
            }
            (count, start) = (u64_at(bytes, larger.checked_add(32)?)?, u64_at(bytes, larger.checked_add(48)?)?);
        }
    }
    let mut rest = bytes.get(usize::try_from(start).ok()?..)?;
    let mut members = Vec::new();
    for _ in 0..count {
        if u32_at(rest, 0)? != 0x0201_4b50 {
            return None;
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| u16_at(rest, at).map(usize::from));
        let (name, extra, comment) = (name?, extra?, comment?);
        let mut member = Member {
            name: rest.get(46..46 + name)?,
            method: u16_at(rest, 10)?,
            encrypted: u16_at(rest, 8)? & 1 == 1,
            packed: u32_at(rest, 20)?.into(),
            whole: u32_at(rest, 24)?.into(),
            start: u32_at(rest, 42)?.into(),
        };
        widen(&mut member, rest.get(46 + name..46 + name + extra)?);
        members.push(member);
        rest = rest.get(46 + name + extra + comment..)?;
    }
    Some(members)
}

/// Replaces the sizes that don't fit 32 bits by those of the ZIP64 field.
fn widen(member: &mut Member<'_>, mut extra: &[u8]) {
    while let (Some(tag), Some(length)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let Some((mut field, after)) = extra[4..].split_at_checked(length.into()) else { return };
        if tag == 1 {
            for value in [&mut member.whole, &mut member.packed, &mut member.start] {
                if let (0xffff_ffff, Some(wide)) = (*value, u64_at(field, 0)) {
                    *value = wide;
                    field = &field[8..];
                }
            }
        }
        extra = after;
    }
}
